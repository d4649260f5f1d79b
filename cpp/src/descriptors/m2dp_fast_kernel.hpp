// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The hot loop of M2DP and c-M2DP for the sizes of the papers: every point against every plane.
#pragma once

#include <cstddef>
#include <cstdint>

#include "../detail/simd.hpp"

namespace fusionslam::detail {

constexpr int fast_rings = 8;
constexpr int fast_sectors = 16;
constexpr int fast_color_bins = 16;
constexpr int fast_shape_row = fast_sectors;                        ///< bytes a ring without colour
constexpr int fast_color_row = fast_sectors + 3 * fast_color_bins;  ///< with colour: one cache line
constexpr std::size_t fast_group = 8;                               ///< planes counted at a time
constexpr std::size_t fast_block = 240;               ///< points at a time: byte counters hold 255
constexpr std::size_t fast_chunk = 272 * fast_block;  ///< points at most: 16 bits hold 65,535

/// A plane whose y axis has no first component, as that of a projected (1, 0, 0) never has.
struct FastPlane {
  float minus_x_axis[3];
  float y_axis[2];  ///< second and third component
};

/// Points in units of the outer radius, and one row of bytes a point to be added to its ring's.
struct FastBlock {
  alignas(64) float x[fast_block + 16] = {};
  alignas(64) float y[fast_block + 16] = {};
  alignas(64) float z[fast_block + 16] = {};
  alignas(64) std::uint8_t color_rows[fast_block][fast_color_row] = {};
  std::size_t size = 0;
};

/// Adds one vote a point to each plane of a group:
/// votes[fast_group][fast_rings][fast_shape_row or fast_color_row], where the place of a sector in
/// its row is not its number but fast_sector_code() of it. All levels give the same votes.
struct FastKernel {
  void (*shape)(const FastBlock& block, const FastPlane* planes, std::uint16_t* votes);
  void (*color)(const FastBlock& block, const FastPlane* planes, std::uint16_t* votes);
};

FastKernel fast_kernel(SimdLevel level);

/// Place of sector 0 .. 15 (from -pi, anticlockwise) in a row of votes.
int fast_sector_code(int sector);

}  // namespace fusionslam::detail
