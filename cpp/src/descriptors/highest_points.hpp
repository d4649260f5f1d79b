// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Heights of the highest points of bins, of which Scan Contexts are made.
#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "../detail/checks.hpp"
#include "fusionslam/sensors.hpp"
#include "polar_grid.hpp"

namespace fusionslam::detail {

inline float height_above_ground(const float* point, double origin_height) {
  return static_cast<float>(point[2] + origin_height);
}

/// Of each bin the height above the ground of its highest point, 0 without one above it; nothing
/// at all if no bin has one. bin_of(point) is -1 where a point is in no bin.
template <class BinOf>
std::vector<float> highest_points(PointsView points, double origin_height, std::size_t bins,
                                  BinOf&& bin_of) {
  std::vector<float> heights(bins);
  bool empty = true;
  for (std::size_t i = 0; i < points.size; ++i) {
    const float height = height_above_ground(points[i], origin_height);
    if (!(height > 0)) continue;  // to find its bin takes longer
    const std::ptrdiff_t bin = bin_of(points[i]);
    if (bin < 0) continue;
    float& highest = heights[static_cast<std::size_t>(bin)];
    highest = std::max(highest, height);
    empty = false;
  }
  if (empty) heights.clear();
  return heights;
}

/// The same of the bins of a polar grid. Throws DataError for NaN or infinity and if no bin has a
/// point above the ground; `section` is that of the options.
inline std::vector<float> highest_points(PointsView points, double origin_height,
                                         const PolarGrid& grid, const char* what,
                                         const char* section) {
  check_points(points, 1, what);
  std::vector<float> heights = highest_points(
      points, origin_height, grid.size(), [&](const float* point) { return grid.bin_of(point); });
  if (heights.empty())
    throw DataError(std::string(what) + ": the cloud has no point above the ground within " +
                    section + ".max_range, which is " + std::to_string(grid.max_range) + " m");
  return heights;
}

}  // namespace fusionslam::detail
