// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The hot loops of the neighbour searches, for every instruction set. All distances are FLANN's:
// (dx^2 + dy^2) + dz^2 in float.
#pragma once

#include <cstddef>
#include <cstdint>

#include "fusionslam/simd.hpp"

namespace fusionslam::detail {

/// Points a block, and boxes a group.
inline constexpr std::size_t block_size = 16;

/// Neighbouring points; unused places at the end of the last block hold NaN.
struct alignas(64) PointBlock {
  float x[block_size], y[block_size], z[block_size];
};

struct Box {
  float low[3], high[3];
};

/// Boxes around blocks or around groups of the next finer level; unused ones are empty (low is
/// infinity, high is minus infinity).
struct alignas(64) BoxGroup {
  float low[3][block_size], high[3][block_size];
};

struct NeighborKernels {
  /// Appends to `found` the number `first + i` of each box i of the group that may hold a point
  /// nearer than sqrt(squared_radius) to a point in `box`; returns how many. `found` has room for
  /// block_size of them.
  std::size_t (*boxes_within)(const BoxGroup& group, const Box& box, float squared_radius,
                              std::uint32_t first, std::uint32_t* found);

  /// Squared distances, below squared_radius, and places (block * block_size + i) of the points of
  /// these blocks; returns how many. Both outputs have room for all points of all these blocks.
  std::size_t (*points_within)(const PointBlock* blocks, const std::uint32_t* which,
                               std::size_t count, const float* query, float squared_radius,
                               float* squared_distances, std::uint32_t* places);

  /// ranks[i]: how many values are smaller than values[i]. Both arrays have room for `count`
  /// rounded up to a multiple of block_size. Returns the sum of the ranks, which is
  /// count * (count - 1) / 2 if and only if no two values are equal.
  std::size_t (*ranks)(float* values, std::size_t count, std::uint32_t* ranks);

  /// Lowers each nearest[i] to the squared distance of query i to its nearest point of `other`.
  void (*nearest)(const PointBlock& queries, const PointBlock& other, float* nearest);

  /// The same within one block, where no point is its own neighbour.
  void (*nearest_in_block)(const PointBlock& block, float* nearest);

  /// True if, for any i, a point of the box may be nearer to query i than nearest[i].
  bool (*any_nearer)(const PointBlock& queries, const Box& box, const float* nearest);
};

/// The kernels of a level that simd_level() or best_simd_level() allows.
NeighborKernels neighbor_kernels(SimdLevel level);

}  // namespace fusionslam::detail
