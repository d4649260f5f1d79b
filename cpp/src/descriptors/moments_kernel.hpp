// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "../detail/point_block.hpp"

namespace fusionslam::detail {

/// A rotation (rows) after a shift: q = rows (p - origin).
struct KernelFrame {
  double origin[3];
  double rows[3][3];
};

/// Sums over a cloud in double precision. All levels add in the same order and give the same bits.
struct MomentsKernel {
  /// Adds x, y, z to sums[0 .. 2].
  void (*sum)(RawPoints points, double* sums);
  /// Adds xx, yy, zz, xy, xz, yz of the differences from `mean` to sums[0 .. 5].
  void (*scatter)(RawPoints points, const double* mean, double* sums);
  /// Largest squared length after `frame`, at least `largest`.
  double (*largest_squared)(RawPoints points, const KernelFrame& frame, double largest);
  /// Coordinates after `frame` as float, an array each.
  void (*transform)(RawPoints points, const KernelFrame& frame, float* x, float* y, float* z);
};

MomentsKernel moments_kernel(SimdLevel level);

}  // namespace fusionslam::detail
