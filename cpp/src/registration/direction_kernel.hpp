// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "../detail/point_block.hpp"

namespace fusionslam::detail {

/// A rigid motion, and the grid of directions about the origin that it moves to.
struct DirectionGrid {
  float motion[12];  ///< row-major 3 x 4
  int rows, columns;
};

/// Where the points of one block lie after the motion.
struct DirectionBlock {
  alignas(64) float x[point_block], y[point_block], z[point_block], range[point_block];
  alignas(64) int cell[point_block];  ///< row-major
};

/// Moves the points from `begin` on; returns how many they are.
using FindDirections = std::size_t(RawPoints points, std::size_t begin, const DirectionGrid& grid,
                                   DirectionBlock& block);

FindDirections* direction_kernel(SimdLevel level);

}  // namespace fusionslam::detail
