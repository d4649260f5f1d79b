// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <limits>
#include <random>

#include "fusionslam/fusion.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;

/// stamp_from_then of a scanner that turns at 3 rad/s while it drives at 15 m/s.
Eigen::Isometry3d pose_at(double seconds) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.rotate(Eigen::AngleAxisd(3 * seconds, Eigen::Vector3d(0.1, -0.2, 1).normalized()));
  pose.pretranslate(Eigen::Vector3d(15 * seconds, 0.4 * seconds, 0));
  return pose;
}

ScanPath path_of(double first, double last, int poses) {
  ScanPath path{first, last, {}};
  for (int k = 0; k < poses; ++k) {
    const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> pose =
        pose_at(first + (last - first) * k / std::max(1, poses - 1)).matrix();
    std::copy_n(pose.data(), 16, path.poses.emplace_back().begin());
  }
  return path;
}

TEST_CASE("points are moved by the pose of their own time") {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> place(-40, 40), time(-0.05, 0.05);
  std::vector<float> points;
  std::vector<double> seconds;
  for (int i = 0; i < 2000; ++i) {
    for (int axis = 0; axis < 3; ++axis) points.push_back(static_cast<float>(place(random)));
    seconds.push_back(time(random));
  }
  seconds.front() = -0.05, seconds.back() = 0.05;
  const PointsView view{points.data(), seconds.size()};
  const auto moved = deskew(view, seconds, path_of(-0.05, 0.05, 33));
  double worst = 0;
  for (std::size_t i = 0; i < seconds.size(); ++i) {
    const Eigen::Vector3f given(points[3 * i], points[3 * i + 1], points[3 * i + 2]);
    const Eigen::Vector3f found(moved[3 * i], moved[3 * i + 1], moved[3 * i + 2]);
    const Eigen::Vector3d wanted = pose_at(seconds[i]) * given.cast<double>();
    worst = std::max(worst, (found.cast<double>() - wanted).norm());
  }
  CHECK(worst < 1e-3);
}

TEST_CASE("points beyond the path move with its ends, and rays without return stay without") {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<float> points{1, 2, 3, 1, 2, 3, nan, nan, nan};
  const std::vector<double> seconds{-1, 1, 0};
  const auto moved = deskew({points.data(), 3}, seconds, path_of(0, 0.1, 9));
  for (std::size_t i = 0; i < 2; ++i) {
    const Eigen::Vector3d wanted = pose_at(i == 0 ? 0 : 0.1) * Eigen::Vector3d(1, 2, 3);
    for (std::size_t axis = 0; axis < 3; ++axis)
      CHECK(moved[3 * i + axis] == doctest::Approx(wanted[static_cast<int>(axis)]).epsilon(1e-5));
  }
  CHECK(std::isnan(moved[6]));
  CHECK(deskew({points.data(), 1}, std::vector<double>{0.0}, path_of(0, 0, 1)).at(1) == 2);
}

TEST_CASE("paths and times that mean nothing are refused") {
  const std::vector<float> points{1, 2, 3};
  const PointsView view{points.data(), 1};
  const std::vector<double> now{0.0}, never{std::numeric_limits<double>::quiet_NaN()};
  const ScanPath path = path_of(0, 0.1, 3);
  ScanPath broken = path;
  broken.poses[1][3] = std::numeric_limits<double>::infinity();
  check_refused<ShapeError>([&] { deskew(view, std::vector<double>{}, path); },
                            "0 times for 1 points");
  check_refused<DataError>([&] { deskew(view, never, path); }, "time of point 0");
  check_refused<DataError>([&] { deskew(view, now, {}); }, "no pose");
  check_refused<DataError>([&] { deskew(view, now, broken); }, "not finite");
  check_refused<DataError>([&] { deskew(view, now, {0.2, 0.1, path.poses}); }, "not earlier");
}

}  // namespace
}  // namespace fusionslam
