// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The two contexts of Scan Context++ (Kim, Choi, Kim, IEEE Transactions on Robotics 2022).
#include "fusionslam/descriptors/scan_context_plus.hpp"

#include <cmath>
#include <sstream>

#include "../detail/checks.hpp"
#include "fusionslam/matching.hpp"
#include "highest_points.hpp"

namespace fusionslam {
namespace {

constexpr int sectors = static_cast<int>(scan_context_sectors);
constexpr int rings = 20;
constexpr int columns = 40;
constexpr int rows = 40;

/// The interval of `count` equal ones from -reach to reach that a coordinate lies in; -1 if none.
int interval_of(double coordinate, double reach, int count) {
  const double place = std::floor((coordinate / reach + 1) / 2 * count);
  return place >= 0 && place < count ? static_cast<int>(place) : -1;
}

}  // namespace

std::vector<float> scan_context_polar(PointsView points, const ScanContextPolarConfig& config) {
  validate(config);
  return detail::highest_points(points, config.height, {sectors, rings, config.max_range},
                                "scan_context_polar", ScanContextPolarConfig::section);
}

std::vector<float> scan_context_cartesian(PointsView points,
                                          const ScanContextCartesianConfig& config) {
  validate(config);
  detail::check_points(points, 1, "scan_context_cartesian");
  const auto cell_of = [&](const float* point) -> std::ptrdiff_t {
    const int column = interval_of(point[1], config.lateral_range, columns);
    const int row = interval_of(point[0], config.longitudinal_range, rows);
    return column < 0 || row < 0 ? -1 : column * rows + row;
  };
  std::vector<float> heights =
      detail::highest_points(points, config.height, columns * rows, cell_of);
  if (heights.empty()) {
    std::ostringstream message;
    message << "scan_context_cartesian: the cloud has no point above the ground within "
            << config.longitudinal_range << " m ahead and back (longitudinal_range) and "
            << config.lateral_range << " m to the sides (lateral_range)";
    throw DataError(message.str());
  }
  return heights;
}

}  // namespace fusionslam
