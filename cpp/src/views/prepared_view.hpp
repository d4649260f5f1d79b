// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// A range image unpacked for alignment: points, normals, and a table from direction to point.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "../detail/quick_atan2.hpp"
#include "fusionslam/views/range_image.hpp"

namespace fusionslam::detail {

/// Contents and positions of the cells of one view.
struct PreparedView {
  static constexpr int nothing = -1;  ///< in view, but no point there
  static constexpr int outside = -2;  ///< not in view

  std::vector<std::array<float, 3>> points;
  std::vector<std::array<float, 3>> normals;  ///< NaN where a cell has no neighbours
  std::vector<float> ranges;
  std::vector<std::array<float, 3>> colors;
  std::array<float, 3> sensor{};
  float steps_per_rad_azimuth = 0, steps_per_rad_elevation = 0;
  int circle = 0;                     ///< columns around
  int first_column = 0, columns = 0;  ///< in view
  int first_row = 0, rows = 0;
  std::vector<int> table;  ///< rows x columns: number of the point, or nothing

  std::size_t size() const { return points.size(); }
  bool has_normal(std::size_t i) const { return normals[i][0] == normals[i][0]; }
  int at(int row, int column) const {
    if (row < 0 || row >= rows || column < 0 || column >= columns) return outside;
    return table[static_cast<std::size_t>(row * columns + column)];
  }
  int column_of(int absolute) const {
    const int relative = (absolute - first_column) % circle;
    return relative < 0 ? relative + circle : relative;
  }
  /// Row, column and range of a point as the sensor of this view would see it.
  void locate(const float point[3], int& row, int& column, float& range) const {
    const float x = point[0] - sensor[0], y = point[1] - sensor[1], z = point[2] - sensor[2];
    const float level = std::sqrt(x * x + y * y);
    range = std::sqrt(level * level + z * z);
    column =
        column_of(static_cast<int>(std::floor(quick_atan2(y, x) * steps_per_rad_azimuth + 0.5f)));
    row = static_cast<int>(std::floor(quick_atan2(z, level) * steps_per_rad_elevation + 0.5f)) -
          first_row;
  }
};

/// Throws nothing; an empty image gives a view of nothing.
PreparedView prepare(const RangeImage& image);

}  // namespace fusionslam::detail
