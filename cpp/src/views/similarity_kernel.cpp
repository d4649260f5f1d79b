// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "similarity_kernel.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "../detail/simd.hpp"

namespace fusionslam::detail {
namespace {

/// e^x to two units in the last place, for |x| <= 80: 2^n times a polynomial in what is left, with
/// ln 2 in two parts (Cody and Waite 1980).
FUSIONSLAM_INLINE float exponential(float x) {
  constexpr float to_whole =
      0x1.8p23F;  // adding it leaves the nearest whole number in the low bits
  const float shifted = x * 1.44269504F + to_whole;
  const float whole = shifted - to_whole;
  const float rest = (x - whole * 0.693359375F) + whole * 2.12194440e-4F;
  float power = 1.0F / 720;
  power = power * rest + 1.0F / 120;
  power = power * rest + 1.0F / 24;
  power = power * rest + 1.0F / 6;
  power = power * rest + 0.5F;
  power = power * rest + 1.0F;
  power = power * rest + 1.0F;
  const std::uint32_t exponent = std::bit_cast<std::uint32_t>(shifted) << 23;
  return std::bit_cast<float>(std::bit_cast<std::uint32_t>(power) + exponent);
}

FUSIONSLAM_INLINE float sigmoid(float difference, const KernelTerm& term) {
  const float t = std::min(std::max(term.a * (difference - term.x0), -term.limit), term.limit);
  return term.factor / (1.0F + exponential(t));
}

FUSIONSLAM_INLINE float length(const double* point, const std::array<const double*, 3>& columns,
                               std::size_t i) {
  const auto x = static_cast<float>(point[0] - columns[0][i]);
  const auto y = static_cast<float>(point[1] - columns[1][i]);
  const auto z = static_cast<float>(point[2] - columns[2][i]);
  return std::sqrt(x * x + y * y + z * z);
}

FUSIONSLAM_INLINE void add_distance(const double* point,
                                    const std::array<const double*, 3>& columns,
                                    const KernelTerm& given, const KernelRow& row) {
  const KernelTerm term = given;
  float* __restrict sums = row.sums;
  if (row.closeness == nullptr) {
    for (std::size_t i = 0; i < row.size; ++i) sums[i] += sigmoid(length(point, columns, i), term);
    return;
  }
  for (std::size_t i = 0; i < row.size; ++i)
    sums[i] +=
        sigmoid(length(point, columns, i) * std::max(row.own_closeness, row.closeness[i]), term);
}

FUSIONSLAM_INLINE void add_absolute(double value, const double* column, const KernelTerm& given,
                                    const KernelRow& row) {
  const KernelTerm term = given;
  float* __restrict sums = row.sums;
  for (std::size_t i = 0; i < row.size; ++i)
    sums[i] += sigmoid(std::fabs(static_cast<float>(value - column[i])), term);
}

FUSIONSLAM_INLINE void add_given(const float* differences, const KernelTerm& given,
                                 const KernelRow& row) {
  const KernelTerm term = given;
  float* __restrict sums = row.sums;
  for (std::size_t i = 0; i < row.size; ++i) sums[i] += sigmoid(differences[i], term);
}

FUSIONSLAM_INLINE void keep_best(const float* values, std::size_t size, float* __restrict best) {
  for (std::size_t i = 0; i < size; ++i) best[i] = std::max(best[i], values[i]);
}

}  // namespace

SimilarityKernels similarity_kernels(SimdLevel level) {
  return {compiled_for<add_distance>(level), compiled_for<add_absolute>(level),
          compiled_for<add_given>(level), compiled_for<keep_best>(level)};
}

}  // namespace fusionslam::detail
