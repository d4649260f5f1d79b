// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "../detail/interrupt.hpp"
#include "fusionslam/errors.hpp"
#include "fusionslam/fusion.hpp"

namespace fusionslam {
namespace {

constexpr std::size_t block = 65536;  // points between two looks for an interrupt

/// The upper three rows of a pose, and how they change until the next one.
struct Step {
  std::array<float, 12> begin{};
  std::array<float, 12> change{};
};

std::vector<Step> steps_between(const std::vector<Transform>& poses) {
  std::vector<Step> steps(std::max<std::size_t>(1, poses.size() - 1));
  for (std::size_t k = 0; k < steps.size(); ++k) {
    const Transform& next = poses[std::min(k + 1, poses.size() - 1)];
    for (std::size_t i = 0; i < 12; ++i) {
      steps[k].begin[i] = static_cast<float>(poses[k][i]);
      steps[k].change[i] = static_cast<float>(next[i] - poses[k][i]);
    }
  }
  return steps;
}

void check(PointsView points, std::span<const double> seconds, const ScanPath& path) {
  if (seconds.size() != points.size)
    throw ShapeError("deskew: " + std::to_string(seconds.size()) + " times for " +
                     std::to_string(points.size) + " points");
  if (path.poses.empty()) throw DataError("deskew: the path has no pose");
  if (!(path.first <= path.last && std::isfinite(path.last - path.first)))
    throw DataError("deskew: the path goes from " + std::to_string(path.first) + " to " +
                    std::to_string(path.last) + " s, expected a last pose that is not earlier");
  for (const Transform& pose : path.poses)
    for (const double value : pose)
      if (!std::isfinite(value)) throw DataError("deskew: a pose of the path is not finite");
  const auto bad = std::find_if_not(seconds.begin(), seconds.end(),
                                    [](double value) { return std::isfinite(value); });
  if (bad != seconds.end())
    throw DataError("deskew: the time of point " + std::to_string(bad - seconds.begin()) +
                    " is not finite");
}

}  // namespace

std::vector<float> deskew(PointsView points, std::span<const double> seconds,
                          const ScanPath& path) {
  check(points, seconds, path);
  const std::vector<Step> steps = steps_between(path.poses);
  const auto last = static_cast<double>(path.poses.size() - 1);
  const double rate = path.last > path.first + 1e-12 ? last / (path.last - path.first) : 0;
  std::vector<float> moved(3 * points.size);
  for (std::size_t i = 0; i < points.size; ++i) {
    if (i % block == 0) detail::check_interrupt();
    const double place = std::clamp((seconds[i] - path.first) * rate, 0.0, last);
    const auto k = std::min(static_cast<std::size_t>(place), steps.size() - 1);
    const Step& step = steps[k];
    const auto share = static_cast<float>(place - static_cast<double>(k));
    const float* point = points[i];
    for (std::size_t row = 0; row < 3; ++row) {
      const float* from = step.begin.data() + 4 * row;
      const float* by = step.change.data() + 4 * row;
      moved[3 * i + row] = (from[0] + share * by[0]) * point[0] +
                           (from[1] + share * by[1]) * point[1] +
                           (from[2] + share * by[2]) * point[2] + (from[3] + share * by[3]);
    }
  }
  return moved;
}

}  // namespace fusionslam
