// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "column_kernel.hpp"

#include <cmath>

#include "column_vectors.hpp"

namespace fusionslam::detail {
namespace {

// In double: squares of floats neither overflow nor vanish there.
FUSIONSLAM_INLINE std::size_t find_factors(const float* values, std::size_t columns,
                                           std::size_t bins, double* factors) {
  std::size_t filled = 0;
  for (std::size_t column = 0; column < columns; ++column, values += bins) {
    double sum = 0;
    for (std::size_t i = 0; i < bins; ++i)
      sum += static_cast<double>(values[i]) * static_cast<double>(values[i]);
    factors[column] = sum > 0 ? 1 / std::sqrt(sum) : 0;
    filled += sum > 0 ? 1 : 0;
  }
  return filled;
}

FUSIONSLAM_INLINE void scale(const float* values, std::size_t columns, std::size_t bins,
                             const double* factors, float* unit) {
  for (std::size_t column = 0; column < columns; ++column, values += bins, unit += bins) {
    const double factor = factors[column];
    for (std::size_t i = 0; i < bins; ++i)
      unit[i] = static_cast<float>(static_cast<double>(values[i]) * factor);
  }
}

template <std::size_t together>
FUSIONSLAM_INLINE void dots_together(const float* query, const float* row, std::size_t bins,
                                     std::size_t size, float* dots) {
  ColumnVector sums[together] = {};
  for (std::size_t i = 0; i < size; i += column_lanes) {
    const ColumnVector values = load(row + i);
    for (std::size_t t = 0; t < together; ++t) sums[t] += load(query + t * bins + i) * values;
  }
  for (std::size_t t = 0; t < together; ++t) dots[t] = sum_of(sums[t]);
}

FUSIONSLAM_INLINE void dots(const float* query, const float* row, std::size_t bins,
                            std::size_t size, std::size_t shifts, float* dots) {
  constexpr std::size_t together = 6;
  std::size_t shift = 0;
  for (; shift + together <= shifts; shift += together)
    dots_together<together>(query + shift * bins, row, bins, size, dots + shift);
  for (; shift < shifts; ++shift)
    dots_together<1>(query + shift * bins, row, bins, size, dots + shift);
}

}  // namespace

ColumnKernels column_kernels(SimdLevel level) {
  return {compiled_for<find_factors>(level), compiled_for<scale>(level), compiled_for<dots>(level)};
}

}  // namespace fusionslam::detail
