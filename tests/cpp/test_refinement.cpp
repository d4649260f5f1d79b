// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// GICP against its formulas in double, comparing all points with all.
#include <doctest/doctest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstring>
#include <limits>
#include <numbers>
#include <random>
#include <thread>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/registration.hpp"
#include "levels.hpp"
#include "refused.hpp"
#include "registration/gicp_kernel.hpp"
#include "registration/surface_blocks.hpp"

namespace fusionslam {
namespace {

using detail::block_size;
using detail::PointBlock;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using testing::check_refused;

using Points = std::vector<Vector3d>;

/// A rectangle of points between a corner and the ends of two sides, with a little noise.
void add_plane(Points& points, std::mt19937& random, int count, const Vector3d& corner,
               const Vector3d& one, const Vector3d& other) {
  std::uniform_real_distribution<double> along(0, 1);
  std::normal_distribution<double> across(0, 0.005);
  const Vector3d normal = one.cross(other).normalized();
  for (int i = 0; i < count; ++i) {
    const double a = along(random), b = along(random);
    points.push_back(corner + a * one + b * other + across(random) * normal);
  }
}

/// A floor and walls; without ends it is a corridor along x.
Points room(unsigned seed, bool ends) {
  std::mt19937 random(seed);
  Points points;
  add_plane(points, random, 900, {-15, -2, -1}, {30, 0, 0}, {0, 4, 0});
  for (const double y : {-2.0, 2.0})
    add_plane(points, random, 700, {-15, y, -1}, {30, 0, 0}, {0, 0, 3});
  for (const double x : {-15.0, 15.0})
    if (ends) add_plane(points, random, 150, {x, -2, -1}, {0, 4, 0}, {0, 0, 3});
  return points;
}

SurfaceCloud surface(const Points& points, int neighbors = 10) {
  std::vector<float> values;
  for (const Vector3d& point : points)
    for (int axis = 0; axis < 3; ++axis) values.push_back(static_cast<float>(point[axis]));
  return SurfaceCloud({values.data(), points.size()}, neighbors);
}

Transform transform(const Eigen::Isometry3d& pose) {
  Transform values;
  Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(values.data()) = pose.matrix();
  return values;
}

Eigen::Isometry3d isometry(const Transform& values) {
  Eigen::Isometry3d pose;
  pose.matrix() = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(values.data());
  return pose;
}

Eigen::Isometry3d small_motion() {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::AngleAxisd(0.05, Vector3d(0.2, -0.3, 0.9).normalized()).matrix();
  pose.translation() = Vector3d(0.3, -0.2, 0.1);
  return pose;
}

Vector3d at(const std::vector<PointBlock>& blocks, std::size_t place) {
  const PointBlock& block = blocks[place / block_size];
  const std::size_t i = place % block_size;
  return {block.x[i], block.y[i], block.z[i]};
}

Vector3d point_at(const SurfaceCloud& cloud, std::size_t place) {
  const auto& point = cloud.blocks().cloud.points()[place];
  return {point.x, point.y, point.z};
}

/// Place of the point of a cloud that is nearest.
std::size_t nearest(const SurfaceCloud& cloud, const Vector3d& query) {
  std::size_t best = 0;
  for (std::size_t i = 1; i < cloud.size(); ++i)
    if ((point_at(cloud, i) - query).norm() < (point_at(cloud, best) - query).norm()) best = i;
  return best;
}

TEST_CASE("normals are those of the covariance of the nearest points") {
  const Points points = room(1, true);
  for (const int neighbors : {10, 20}) {
    const SurfaceCloud cloud = surface(points, neighbors);
    for (std::size_t place = 0; place < cloud.size(); place += 7) {
      Points known;
      for (std::size_t i = 0; i < cloud.size(); ++i)
        known.push_back(point_at(cloud, i) - point_at(cloud, place));
      std::sort(known.begin(), known.end(),
                [](const auto& a, const auto& b) { return a.norm() < b.norm(); });
      known.resize(static_cast<std::size_t>(neighbors));
      Vector3d mean = Vector3d::Zero();
      for (const Vector3d& each : known) mean += each / neighbors;
      Matrix3d scatter = Matrix3d::Zero();
      for (const Vector3d& each : known) scatter += (each - mean) * (each - mean).transpose();
      const Eigen::SelfAdjointEigenSolver<Matrix3d> axes(scatter);
      if (axes.eigenvalues()[1] < 1.5 * axes.eigenvalues()[0]) continue;  // no clear normal
      CHECK(std::abs(axes.eigenvectors().col(0).dot(at(cloud.blocks().normals, place))) > 0.9999);
    }
  }
}

TEST_CASE("inliers, error and information are those of the formulas") {
  const SurfaceCloud source = surface(room(1, true)), target = surface(room(2, true));
  constexpr double distance = 0.4;
  const Refinement found =
      refine_pose(source, target, transform(small_motion()), {distance, 30, 1e-5});
  CHECK(found.converged);
  const Eigen::Isometry3d pose = isometry(found.target_from_source);
  Matrix6 information = Matrix6::Zero();
  double error = 0;
  std::size_t inliers = 0;
  for (std::size_t place = 0; place < source.size(); ++place) {
    const Vector3d p = point_at(source, place);
    const std::size_t there = nearest(target, pose * p);
    const Vector3d apart = point_at(target, there) - pose * p;
    if (apart.norm() > distance) continue;
    ++inliers;
    const Vector3d n = at(target.blocks().normals, there);
    const Vector3d m = pose.linear() * at(source.blocks().normals, place);
    const Matrix3d covariance =
        2 * Matrix3d::Identity() - 0.999 * n * n.transpose() - 0.999 * m * m.transpose();
    const Matrix3d weight = covariance.inverse();
    error += apart.dot(weight * apart) / 2;
    Eigen::Matrix<double, 3, 6> jacobian;
    jacobian.leftCols<3>() = pose.linear();
    for (int axis = 0; axis < 3; ++axis)
      jacobian.col(3 + axis) = pose.linear() * Vector3d::Unit(axis).cross(p);
    information += jacobian.transpose() * weight * jacobian;
  }
  CHECK(std::abs(static_cast<double>(found.inliers) - static_cast<double>(inliers)) <= 1);
  CHECK(found.error == doctest::Approx(error).epsilon(0.01));
  const Matrix6 given = Eigen::Map<const Matrix6>(found.information.data());
  CHECK((given - information).norm() < 0.01 * information.norm());
}

TEST_CASE("a motion of the same points is found exactly") {
  const Points points = room(3, true);
  Points moved;
  for (const Vector3d& point : points) moved.push_back(small_motion().inverse() * point);
  const Refinement found = refine_pose(surface(moved), surface(points), identity_transform);
  CHECK(found.converged);
  CHECK((isometry(found.target_from_source).matrix() - small_motion().matrix()).norm() < 1e-4);
}

TEST_CASE("information shows the directions in which clouds slide on each other") {
  std::mt19937 random(1);
  Points plane;
  add_plane(plane, random, 2000, {-10, -10, 0}, {20, 0, 0}, {0, 20, 0});
  struct Case {
    Points one, other;
    std::vector<int> weak;  // translations
  };
  for (const Case& each : {Case{plane, plane, {0, 1}}, {room(1, false), room(2, false), {0}}}) {
    const Refinement found =
        refine_pose(surface(each.one), surface(each.other), identity_transform);
    const Matrix6 information = Eigen::Map<const Matrix6>(found.information.data());
    for (int axis = 0; axis < 3; ++axis) {
      const bool weak = std::count(each.weak.begin(), each.weak.end(), axis) > 0;
      const double share = information(axis, axis) / static_cast<double>(found.inliers);
      CHECK((weak ? share < 5 : share > 50));
    }
  }
}

TEST_CASE("every level gives the same bytes") {
  const SurfaceCloud source = surface(room(1, true)), target = surface(room(2, true));
  const auto& one = source.blocks();
  const auto& other = target.blocks();
  const detail::Motion motion{{0.8F, -0.6F, 0, 0.6F, 0.8F, 0, 0, 0, 1}, {0.5F, 0.25F, -0.125F}};
  std::vector<std::uint32_t> places(one.cloud.block_count() * block_size, detail::no_place);
  for (std::size_t i = 0; i < source.size(); ++i)
    if (i % 3 != 0) places[i] = static_cast<std::uint32_t>(i * 7 % target.size());
  const auto run = [&](SimdLevel level) {
    std::vector<unsigned char> bytes;
    const auto keep = [&](const auto& value) {
      const auto* begin = reinterpret_cast<const unsigned char*>(&value);
      bytes.insert(bytes.end(), begin, begin + sizeof value);
    };
    const detail::GicpKernels kernels = detail::gicp_kernels(level);
    for (std::size_t count : {std::size_t{10}, std::size_t{20}}) {
      alignas(64) float smallest[20][block_size];
      std::fill_n(smallest[0], 20 * block_size, std::numeric_limits<float>::infinity());
      detail::NeighborSums sums{};
      detail::Nearest near{};
      std::fill_n(near.squared, block_size, 3.0F);
      std::fill_n(near.second, block_size, 3.0F);
      const PointBlock& queries = one.cloud.blocks()[3];
      for (std::size_t block = 0; block < 12; ++block) {
        const PointBlock& points = other.cloud.blocks()[block];
        kernels.insert_smallest(queries, points, count, smallest);
        kernels.lower_nearest(queries, points, static_cast<std::uint32_t>(16 * block), near);
      }
      for (std::size_t block = 0; block < 12; ++block)
        kernels.add_neighbors(queries, other.cloud.blocks()[block], smallest[count - 1], sums);
      PointBlock normals;
      kernels.find_normals(sums, normals);
      keep(smallest), keep(sums), keep(near), keep(normals);
    }
    detail::Pairing pairing{one.cloud.blocks(),   one.normals.data(), other.cloud.blocks(),
                            other.normals.data(), places.data(),      one.cloud.block_count()};
    detail::NormalEquations equations{};
    std::vector<std::uint32_t> pairs(places.size());
    kernels.linearize(pairing, motion, 25, pairs.data(), equations);
    CHECK(equations.inliers > 100);
    pairing.places = pairs.data();
    keep(equations);
    keep(kernels.sum_error(pairing, motion));
    CHECK(kernels.sum_error(pairing, motion) == doctest::Approx(equations.error));
    return bytes;
  };
  for (const SimdLevel level : simd_levels()) CHECK(run(level) == run(SimdLevel::baseline));
}

TEST_CASE("threads that share clouds get the same bytes") {
  const SurfaceCloud source = surface(room(1, true)), target = surface(room(2, true));
  const auto run = [&] { return refine_pose(source, target, transform(small_motion())); };
  const Refinement alone = run();
  std::vector<Refinement> found(4);
  {
    std::vector<std::jthread> threads;
    for (Refinement& each : found) threads.emplace_back([&] { each = run(); });
  }
  for (const Refinement& each : found) {
    CHECK(each.target_from_source == alone.target_from_source);
    CHECK(each.information == alone.information);
  }
}

TEST_CASE("bad clouds, poses and limits are refused, and far clouds have no neighbours") {
  Points points = room(1, true);
  const SurfaceCloud cloud = surface(points);
  const auto refine = [&](const Transform& start, const RefinementLimits& limits) {
    return [&cloud, start, limits] { refine_pose(cloud, cloud, start, limits); };
  };
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double distance : {0.0, nan, 1e16})
    check_refused<ConfigError>(refine(identity_transform, {distance, 30, 1e-4}), "distance is");
  check_refused<ConfigError>(refine(identity_transform, {1, 0, 1e-4}), "iterations is 0");
  for (const double step : {0.0, nan})
    check_refused<ConfigError>(refine(identity_transform, {1, 30, step}), "step is");
  Transform start = identity_transform;
  start[0] = 2;
  check_refused<DataError>(refine(start, {}), "no rigid motion");
  start = identity_transform;
  start[3] = 1e16;
  check_refused<DataError>(refine(start, {}), "from the origin");
  for (const int neighbors : {0, 2, 65})
    check_refused<ConfigError>([&] { surface(points, neighbors); }, "3 to 64");
  check_refused<DataError>([&] { surface(Points(19, Vector3d::Zero())); }, "19 points");
  for (const double value : {nan, 1e20}) {
    points[7].y() = value;
    check_refused<DataError>([&] { surface(points); }, "point 7");
  }

  start[3] = 1e9;
  const Refinement far = refine_pose(cloud, cloud, start);
  CHECK((!far.converged && far.inliers == 0 && far.target_from_source == start));
  const SurfaceCloud heap = surface(Points(30, Vector3d(1, 2, 3)));  // without any extent
  const Refinement same = refine_pose(heap, heap, identity_transform);
  CHECK((same.inliers == 30 && same.error == 0));
  for (const double value : same.information) CHECK(std::isfinite(value));
}

}  // namespace
}  // namespace fusionslam
