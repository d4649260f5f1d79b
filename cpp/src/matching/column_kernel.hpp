// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Rows of columns, such as Scan Contexts, compared while one is shifted by whole columns.
#pragma once

#include <cstddef>

#include "../detail/simd.hpp"

namespace fusionslam::detail {

/// Floats summed side by side: part of the result, so the same on every level.
constexpr std::size_t column_lanes = 8;

/// `count` rounded up to whole lanes.
constexpr std::size_t whole_lanes(std::size_t count) {
  return (count + column_lanes - 1) / column_lanes * column_lanes;
}

struct ColumnKernels {
  /// Writes 1 / the length of each of `columns`, `bins` floats long, or 0 where that is 0, and
  /// returns how many are not.
  std::size_t (*find_factors)(const float* values, std::size_t columns, std::size_t bins,
                              double* factors);

  /// Writes each column times its factor. `unit` may not overlap `values`.
  void (*scale)(const float* values, std::size_t columns, std::size_t bins, const double* factors,
                float* unit);

  /// dots[i] is the product of `row` with the floats of `query` from column i on, for i below
  /// `shifts`. `size` is that of a row, rounded up to whole lanes and filled with zeros; `query`
  /// goes on beyond its end as its shifts need.
  void (*dots)(const float* query, const float* row, std::size_t bins, std::size_t size,
               std::size_t shifts, float* dots);
};

ColumnKernels column_kernels(SimdLevel level);

}  // namespace fusionslam::detail
