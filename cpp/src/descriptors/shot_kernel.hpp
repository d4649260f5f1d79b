// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The passes over all points that SHOT at one keypoint makes, for every instruction set.
#pragma once

#include <cstddef>
#include <cstdint>

#include "fusionslam/simd.hpp"

namespace fusionslam::detail {

inline constexpr int shot_volumes = 32;      ///< 8 azimuths x 2 radii x 2 elevations
inline constexpr int shot_shape_slots = 11;  ///< 10 bins of the cosine and one more
inline constexpr int shot_color_slots = 31;  ///< 30 bins of the colour distance and one more
inline constexpr int shot_shape_size = shot_volumes * shot_shape_slots;
inline constexpr int shot_color_size = shot_volumes * shot_color_slots;

/// Support of a keypoint: points with their unit normals, and for CSHOT their colour distances (0
/// to 1) to the keypoint; `color` is null for SHOT.
struct ShotSupport {
  const float *x, *y, *z;
  const float *normal_x, *normal_y, *normal_z;
  const float* color;
  std::size_t size;
  float center[3];
  double radius;
  float squared_radius;  ///< only points nearer than its root count
};

/// Rows are unit vectors.
struct ShotFrame {
  float x[3], y[3], z[3];
};

struct ShotScatter {
  double sums[6];  ///< xx, xy, xz, yy, yz, zz of the offsets, each times its weight
  double weight;   ///< radius - distance, summed
  std::size_t count;
};

struct ShotSides {
  std::size_t first, second;
};

/// Each works on the points [begin, end). Those at the keypoint itself do not count.
struct ShotKernels {
  ShotScatter (*scatter)(const ShotSupport& support, std::size_t begin, std::size_t end);

  /// Counts the points that do not lie behind the keypoint, along each of two directions.
  ShotSides (*sides)(const ShotSupport& support, std::size_t begin, std::size_t end,
                     const double* first, const double* second);

  /// Adds the votes to `histogram`: shot_shape_size shape bins, then shot_color_size colour bins.
  void (*vote)(const ShotSupport& support, std::size_t begin, std::size_t end,
               const ShotFrame& frame, double* histogram);
};

/// The kernels of a level that simd_level() or best_simd_level() allows.
ShotKernels shot_kernels(SimdLevel level);

}  // namespace fusionslam::detail
