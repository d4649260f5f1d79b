// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "direction_kernel.hpp"

#include <cmath>
#include <numbers>

#include "../detail/quick_atan2.hpp"

namespace fusionslam::detail {
namespace {

constexpr float pi = std::numbers::pi_v<float>;

/// Number of the step of an angle, from 0 at `first`; rounding cannot lead past the last, and NaN,
/// of coordinates whose squares overflow, leads to the first.
FUSIONSLAM_INLINE int step_of(float angle, float first, float steps_per_rad, int steps) {
  const float step = (angle - first) * steps_per_rad;
  return step > 0 ? (step < static_cast<float>(steps) ? static_cast<int>(step) : steps - 1) : 0;
}

FUSIONSLAM_INLINE std::size_t find_directions(RawPoints points, std::size_t begin,
                                              const DirectionGrid& grid, DirectionBlock& block) {
  CoordinateBlock b;
  const std::size_t size = load(points, begin, b);
  const float* m = grid.motion;
  for (std::size_t i = 0; i < size; ++i) {
    block.x[i] = m[0] * b.x[i] + m[1] * b.y[i] + m[2] * b.z[i] + m[3];
    block.y[i] = m[4] * b.x[i] + m[5] * b.y[i] + m[6] * b.z[i] + m[7];
    block.z[i] = m[8] * b.x[i] + m[9] * b.y[i] + m[10] * b.z[i] + m[11];
  }
  const float rows_per_rad = static_cast<float>(grid.rows) / pi;
  const float columns_per_rad = static_cast<float>(grid.columns) / (2 * pi);
  for (std::size_t i = 0; i < size; ++i) {
    const float level = std::sqrt(block.x[i] * block.x[i] + block.y[i] * block.y[i]);
    block.range[i] = std::sqrt(level * level + block.z[i] * block.z[i]);
    const int row = step_of(quick_atan2(block.z[i], level), -pi / 2, rows_per_rad, grid.rows);
    const int column =
        step_of(quick_atan2(block.y[i], block.x[i]), -pi, columns_per_rad, grid.columns);
    block.cell[i] = row * grid.columns + column;
  }
  return size;
}

}  // namespace

FindDirections* direction_kernel(SimdLevel level) { return compiled_for<find_directions>(level); }

}  // namespace fusionslam::detail
