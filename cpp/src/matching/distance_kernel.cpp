// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "distance_kernel.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace fusionslam::detail {

double squared_distance(const float* a, const float* b, std::size_t size) {
  // Four sums, so that additions do not wait for one another; always combined in the same order.
  double sums[4] = {0, 0, 0, 0};
  std::size_t i = 0;
  for (; i + 4 <= size; i += 4) {
    for (std::size_t lane = 0; lane < 4; ++lane) {
      const double difference = static_cast<double>(a[i + lane]) - static_cast<double>(b[i + lane]);
      sums[lane] += difference * difference;
    }
  }
  for (; i < size; ++i) {
    const double difference = static_cast<double>(a[i]) - static_cast<double>(b[i]);
    sums[0] += difference * difference;
  }
  return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

double squared_norm(const float* a, std::size_t size) {
  double sums[8] = {0, 0, 0, 0, 0, 0, 0, 0};
  std::size_t i = 0;
  for (; i + 8 <= size; i += 8)
    for (std::size_t lane = 0; lane < 8; ++lane)
      sums[lane] += static_cast<double>(a[i + lane]) * static_cast<double>(a[i + lane]);
  double sum = 0;
  for (; i < size; ++i) sum += static_cast<double>(a[i]) * static_cast<double>(a[i]);
  for (const double part : sums) sum += part;
  return sum;
}

bool all_within(const float* a, std::size_t size, float limit) {
  int outside = 0;  // no early end: without a branch the loop is vectorised
  for (std::size_t i = 0; i < size; ++i) outside |= !(std::fabs(a[i]) <= limit);
  return outside == 0;
}

void pack_panel(const float* rows, std::size_t count, std::size_t dimension, const float* center,
                std::size_t width, float* panel) {
  constexpr std::size_t block = 16;  // columns, whose part of the panel stays in the first cache
  if (count < width) std::fill_n(panel, dimension * width, 0.0F);
  for (std::size_t begin = 0; begin < dimension; begin += block) {
    const std::size_t end = std::min(begin + block, dimension);
    for (std::size_t r = 0; r < count; ++r)
      for (std::size_t c = begin; c < end; ++c)
        panel[c * width + r] = rows[r * dimension + c] - center[c];
  }
}

namespace {

constexpr double rounding = 0x1p-24;          // of one float operation, relative
constexpr double underflow = 0x1p-120;        // of one column, also where denormals are flushed
constexpr std::size_t columns_per_sum = 256;  // the tile's sums are that long, then added up

/// Higham, Accuracy and Stability of Numerical Algorithms, lemma 3.1: of `count` roundings.
double compound_rounding(std::size_t count) {
  const double error = static_cast<double>(count) * rounding;
  return error < 0.5 ? error / (1 - error) : 1;
}

}  // namespace

ErrorBound direct_error(std::size_t dimension) {
  // A column is rounded when subtracted (counts twice, squared), multiplied, and summed with at
  // most dimension / 4 others, the widest lanes having the shortest sums, then across the lanes.
  return {compound_rounding(dimension / 4 + 40), static_cast<double>(dimension) * underflow};
}

ErrorBound tile_error(std::size_t dimension) {
  // A dot product has an error of at most its roundings times (|p|^2 + |q|^2) / 2 and counts
  // twice. Centring moves each vector by `rounding` of its length: 4 more; squared norms and the
  // last subtraction add 4; flushed denormals are below 1.
  const std::size_t sums = dimension / columns_per_sum + 1;
  return {compound_rounding(std::min(dimension, columns_per_sum) + sums + 12),
          static_cast<double>(dimension) * underflow};
}

namespace baseline {

typedef float Vector __attribute__((vector_size(16), may_alias));
typedef int Mask __attribute__((vector_size(16), may_alias));
constexpr std::size_t lanes = 4;
constexpr std::size_t tile_queries = 6;

FUSIONSLAM_INLINE Vector broadcast(float value) { return Vector{value, value, value, value}; }
FUSIONSLAM_INLINE Vector multiply_add(Vector a, Vector b, Vector c) { return a * b + c; }
FUSIONSLAM_INLINE std::uint32_t not_above(Vector a, Vector b) {
  const Mask above = a > b;
  std::uint32_t bits = 0;
  for (unsigned lane = 0; lane < lanes; ++lane)
    bits |= static_cast<std::uint32_t>(above[lane] == 0) << lane;
  return bits;
}

#include "distance_kernel.inc"

}  // namespace baseline

#if defined(__x86_64__)

#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2,fma"))), apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx2,fma")
#endif
namespace avx2 {

typedef __m256 Vector;
typedef int Mask __attribute__((vector_size(32), may_alias));
constexpr std::size_t lanes = 8;
constexpr std::size_t tile_queries = 6;

FUSIONSLAM_INLINE Vector broadcast(float value) { return _mm256_set1_ps(value); }
FUSIONSLAM_INLINE Vector multiply_add(Vector a, Vector b, Vector c) {
  return _mm256_fmadd_ps(a, b, c);
}
FUSIONSLAM_INLINE std::uint32_t not_above(Vector a, Vector b) {
  return static_cast<std::uint32_t>(_mm256_movemask_ps(_mm256_cmp_ps(a, b, _CMP_NGT_UQ)));
}

#include "distance_kernel.inc"

}  // namespace avx2
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif

#if defined(__clang__)
#pragma clang attribute push(__attribute__((target("avx2,fma,avx512f,avx512dq"))), \
                             apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx2,fma,avx512f,avx512dq,prefer-vector-width=512")
#endif
namespace avx512 {

typedef __m512 Vector;
typedef int Mask __attribute__((vector_size(64), may_alias));
constexpr std::size_t lanes = 16;
constexpr std::size_t tile_queries = 14;

FUSIONSLAM_INLINE Vector broadcast(float value) { return _mm512_set1_ps(value); }
FUSIONSLAM_INLINE Vector multiply_add(Vector a, Vector b, Vector c) {
  return _mm512_fmadd_ps(a, b, c);
}
FUSIONSLAM_INLINE std::uint32_t not_above(Vector a, Vector b) {
  return _mm512_cmp_ps_mask(a, b, _CMP_NGT_UQ);
}

#include "distance_kernel.inc"

}  // namespace avx512
#if defined(__clang__)
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif

DistanceKernels distance_kernels(SimdLevel level) {
  const bool fused = __builtin_cpu_supports("fma");  // some machines have AVX2 without
  if (level == SimdLevel::avx512) return avx512::kernels();
  return level == SimdLevel::avx2 && fused ? avx2::kernels() : baseline::kernels();
}

#else

DistanceKernels distance_kernels(SimdLevel) { return baseline::kernels(); }

#endif

}  // namespace fusionslam::detail
