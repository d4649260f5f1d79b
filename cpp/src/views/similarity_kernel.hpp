// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The hot loops of one scene against many: one object against a row of stored ones.
#pragma once

#include <array>
#include <cstddef>

#include "fusionslam/simd.hpp"

namespace fusionslam::detail {

/// One sigmoid, factor / (1 + exp(a (x - x0))), in single precision.
struct KernelTerm {
  float x0, a, factor;
  /// Of a (x - x0), beyond which the sigmoid is its end for all purposes. No constant of the loops:
  /// there compilers take the exponential of both sides first, whose denormal numbers are slow.
  float limit = 80;
};

/// One row of stored objects, and the result for each.
struct KernelRow {
  std::size_t size;
  const float* closeness;  ///< of each stored object; nullptr where distances are not scaled
  float own_closeness;     ///< of the one object
  float* sums;             ///< what the terms are added to
};

/// Differences are taken in double precision, so that those of large numbers keep their digits; all
/// else is float. All levels give the same bits.
struct SimilarityKernels {
  /// Adds the term of the distances between one point and many, scaled by the larger closeness.
  void (*add_distance)(const double* point, const std::array<const double*, 3>& columns,
                       const KernelTerm& term, const KernelRow& row);
  /// Adds the term of |value - column|.
  void (*add_absolute)(double value, const double* column, const KernelTerm& term,
                       const KernelRow& row);
  /// Adds the term of differences that are there already.
  void (*add_given)(const float* differences, const KernelTerm& term, const KernelRow& row);
  /// best[i] = max(best[i], values[i])
  void (*keep_best)(const float* values, std::size_t size, float* best);
};

SimilarityKernels similarity_kernels(SimdLevel level);

}  // namespace fusionslam::detail
