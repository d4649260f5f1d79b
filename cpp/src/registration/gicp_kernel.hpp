// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The hot loops of GICP (Segal, Haehnel, Thrun 2009), 16 points at a time. All levels give the same
// bits: products in float, one lane a point, sums over blocks in double, lane by lane.
#pragma once

#include <cstddef>
#include <cstdint>

#include "../detail/neighbor_kernel.hpp"

namespace fusionslam::detail {

/// Number of a point that corresponds to none.
inline constexpr std::uint32_t no_place = 0xffffffff;

/// Most points that may give a point its normal.
inline constexpr std::size_t most_neighbors = 64;

/// A rigid motion q = rotation p + shift.
struct Motion {
  float rotation[9];  ///< row-major
  float shift[3];
};

/// What the nearest points of a block's points tell: how many they are; their sums of x, y, z and
/// of xx, xy, xz, yy, yz, zz, relative to each point.
struct alignas(64) NeighborSums {
  float values[10][block_size];
};

/// For each point of a block its nearest other-cloud point, while the search goes on.
struct alignas(64) Nearest {
  float squared[block_size];        ///< squared distance to the nearest
  float second[block_size];         ///< and to the second nearest
  std::uint32_t place[block_size];  ///< of the nearest; no_place if none was nearer than the start
};

/// Sums over all correspondences.
struct NormalEquations {
  double information[21];  ///< upper triangle, row by row: x, y, z, then rotations
  double gradient[6];      ///< of the error, negative
  double error;            ///< half the sum of squared Mahalanobis distances
  double inliers;
};

/// Two clouds and which points of them correspond.
struct Pairing {
  const PointBlock* source;
  const PointBlock* source_normals;
  const PointBlock* target;
  const PointBlock* target_normals;
  const std::uint32_t* places;  ///< of target points, block_size each source block
  std::size_t blocks;           ///< of the source
};

struct GicpKernels {
  /// Inserts the squared distances from each query to all points of `other` into its `count`
  /// smallest, which ascend.
  void (*insert_smallest)(const PointBlock& queries, const PointBlock& other, std::size_t count,
                          float (*smallest)[block_size]);

  /// Adds the points of `other` nearer than sqrt(limit[i]) to query i.
  void (*add_neighbors)(const PointBlock& queries, const PointBlock& other, const float* limit,
                        NeighborSums& sums);

  /// Unit vectors along which the neighbours spread least (any sign).
  void (*find_normals)(const NeighborSums& sums, PointBlock& normals);

  /// Moves the points of a block, and measures how far that is from `before`, squared. Whether any
  /// is farther than sqrt(limit[i]).
  bool (*move)(const PointBlock& points, const Motion& motion, const PointBlock& before,
               const float* limit, PointBlock& moved, float* squared);

  /// Lowers the two smallest distances of each query by those to the points of `other`, of which
  /// the first is at place `first`.
  void (*lower_nearest)(const PointBlock& queries, const PointBlock& other, std::uint32_t first,
                        Nearest& nearest);

  /// Linearises the error about a pose, for motions of the source in its own frame. Pairs farther
  /// apart than sqrt(squared_distance) do not count; the others' places are written to `pairs`.
  void (*linearize)(const Pairing& pairing, const Motion& target_from_source,
                    float squared_distance, std::uint32_t* pairs, NormalEquations& equations);

  /// The error alone, of all pairs.
  double (*sum_error)(const Pairing& pairing, const Motion& target_from_source);
};

/// The kernels of a level that simd_level() or best_simd_level() allows.
GicpKernels gicp_kernels(SimdLevel level);

}  // namespace fusionslam::detail
