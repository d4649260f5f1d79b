// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "sheet_kernel.hpp"

#include "../detail/simd.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t lanes = 16;  // partial sums; how many is part of the result

template <int Reach>
FUSIONSLAM_INLINE void blur(const double* __restrict in, std::size_t stride, std::size_t count,
                            const Window& given, double* __restrict out) {
  const Window window = given;
  const auto step = static_cast<std::ptrdiff_t>(stride);
  for (std::ptrdiff_t i = 0; i < static_cast<std::ptrdiff_t>(count); ++i) {
    double sum = window.weights[0] * in[i];
    for (int k = 1; k <= Reach; ++k)
      sum += window.weights[k] * (in[i - k * step] + in[i + k * step]);
    out[i] = sum;
  }
}

FUSIONSLAM_INLINE double inhibit(const double* __restrict excited,
                                 const double* __restrict inhibited, double taken,
                                 std::size_t count, double* __restrict out) {
  double partial[lanes] = {};
  const std::size_t whole = count - count % lanes;
  for (std::size_t i = 0; i < whole; i += lanes)
    for (std::size_t lane = 0; lane < lanes; ++lane) {
      const double left = excited[i + lane] - inhibited[i + lane] - taken;
      const double kept = left > 0 ? left : 0;
      out[i + lane] = kept;
      partial[lane] += kept;
    }
  for (std::size_t i = whole; i < count; ++i) {
    const double left = excited[i] - inhibited[i] - taken;
    out[i] = left > 0 ? left : 0;
    partial[i - whole] += out[i];
  }
  double sum = 0;
  for (const double part : partial) sum += part;
  return sum;
}

FUSIONSLAM_INLINE void scale(double factor, std::size_t count, double* __restrict cells) {
  for (std::size_t i = 0; i < count; ++i) cells[i] *= factor;
}

FUSIONSLAM_INLINE void mix(const double* __restrict a, double of_a, const double* __restrict b,
                           double of_b, std::size_t count, double* __restrict out) {
  for (std::size_t i = 0; i < count; ++i) out[i] = of_a * a[i] + of_b * b[i];
}

FUSIONSLAM_INLINE double largest(const double* __restrict cells, std::size_t count) {
  double best[lanes] = {};
  const std::size_t whole = count - count % lanes;
  for (std::size_t i = 0; i < whole; i += lanes)
    for (std::size_t lane = 0; lane < lanes; ++lane)
      best[lane] = best[lane] > cells[i + lane] ? best[lane] : cells[i + lane];
  double found = 0;
  for (const double value : best) found = found > value ? found : value;
  for (std::size_t i = whole; i < count; ++i) found = found > cells[i] ? found : cells[i];
  return found;
}

}  // namespace

SheetKernels sheet_kernels(SimdLevel level) {
  return {compiled_for<blur<3>>(level), compiled_for<blur<2>>(level), compiled_for<inhibit>(level),
          compiled_for<scale>(level),   compiled_for<mix>(level),     compiled_for<largest>(level)};
}

}  // namespace fusionslam::detail
