// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "neighbor_kernel.hpp"

#include <cstring>
#include <limits>

#include "simd.hpp"
#include "vectors.hpp"
#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace fusionslam::detail {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();

FUSIONSLAM_INLINE float larger(float a, float b) { return a > b ? a : b; }

/// Distance of the interval [low, high] from [from, to]; never more than the rounded difference of
/// a value of one and a value of the other, as rounding is monotonic.
FUSIONSLAM_INLINE float gap(float low, float high, float from, float to) {
  return larger(larger(low - to, from - high), 0.0F);
}

FUSIONSLAM_INLINE std::size_t boxes_within(const BoxGroup& group, const Box& box,
                                           float squared_radius, std::uint32_t first,
                                           std::uint32_t* found) {
  float squared[block_size];
  for (std::size_t i = 0; i < block_size; ++i) {
    const float x = gap(group.low[0][i], group.high[0][i], box.low[0], box.high[0]);
    const float y = gap(group.low[1][i], group.high[1][i], box.low[1], box.high[1]);
    const float z = gap(group.low[2][i], group.high[2][i], box.low[2], box.high[2]);
    squared[i] = x * x + y * y + z * z;
  }
  std::size_t size = 0;
  for (std::size_t i = 0; i < block_size; ++i) {
    found[size] = first + static_cast<std::uint32_t>(i);
    size += squared[i] < squared_radius;
  }
  return size;
}

/// Ranks of `width` vectors of values at once, so that a value is loaded once for all of them;
/// adds them to `sums`.
template <class Vectors, std::size_t width>
FUSIONSLAM_INLINE void rank_vectors(const float* values, std::size_t count, const float* begin,
                                    std::uint32_t* ranks, typename Vectors::Integers& sums) {
  typename Vectors::Floats own[width];
  typename Vectors::Integers smaller[width]{};
  std::memcpy(own, begin, sizeof own);
  for (std::size_t j = 0; j < count; ++j)
    for (std::size_t k = 0; k < width; ++k) {
      if constexpr (sizeof own[0] == 64)
        smaller[k] = own[k] > values[j] ? smaller[k] + 1 : smaller[k];  // a masked addition
      else
        smaller[k] -= own[k] > values[j];  // true is -1
    }
  std::memcpy(ranks, smaller, sizeof smaller);
  for (std::size_t k = 0; k < width; ++k) sums += smaller[k];
}

template <class Vectors>
FUSIONSLAM_INLINE std::size_t rank(float* values, std::size_t count, std::uint32_t* ranks) {
  constexpr std::size_t lanes = sizeof(typename Vectors::Floats) / sizeof(float);
  const std::size_t padded = (count + block_size - 1) / block_size * block_size;
  for (std::size_t i = count; i < padded; ++i) values[i] = -infinity;  // their ranks are 0
  typename Vectors::Integers sums{};
  std::size_t i = 0;
  for (; i + 4 * lanes <= padded; i += 4 * lanes)
    rank_vectors<Vectors, 4>(values, count, values + i, ranks + i, sums);
  for (; i < padded; i += lanes)
    rank_vectors<Vectors, 1>(values, count, values + i, ranks + i, sums);
  std::uint32_t lane_sums[lanes];
  std::memcpy(lane_sums, &sums, sizeof sums);
  std::size_t total = 0;
  for (const std::uint32_t sum : lane_sums) total += sum;
  return total;
}

FUSIONSLAM_INLINE void lower_to_distance(const PointBlock& queries, float x, float y, float z,
                                         float* nearest) {
  for (std::size_t i = 0; i < block_size; ++i) {
    const float dx = queries.x[i] - x, dy = queries.y[i] - y, dz = queries.z[i] - z;
    const float squared = dx * dx + dy * dy + dz * dz;
    nearest[i] = squared < nearest[i] ? squared : nearest[i];
  }
}

FUSIONSLAM_INLINE void lower_nearest(const PointBlock& queries, const PointBlock& other,
                                     float* nearest) {
  float lowest[block_size];
  for (std::size_t i = 0; i < block_size; ++i) lowest[i] = nearest[i];
  for (std::size_t j = 0; j < block_size; ++j)
    lower_to_distance(queries, other.x[j], other.y[j], other.z[j], lowest);
  for (std::size_t i = 0; i < block_size; ++i) nearest[i] = lowest[i];
}

FUSIONSLAM_INLINE void lower_nearest_in_block(const PointBlock& block, float* nearest) {
  float lowest[block_size];
  for (std::size_t i = 0; i < block_size; ++i) lowest[i] = nearest[i];
  for (std::size_t j = 0; j < block_size; ++j) {
    const float own = lowest[j];
    lower_to_distance(block, block.x[j], block.y[j], block.z[j], lowest);
    lowest[j] = own;
  }
  for (std::size_t i = 0; i < block_size; ++i) nearest[i] = lowest[i];
}

FUSIONSLAM_INLINE bool any_nearer(const PointBlock& queries, const Box& box, const float* nearest) {
  int nearer = 0;
  for (std::size_t i = 0; i < block_size; ++i) {
    const float x = gap(box.low[0], box.high[0], queries.x[i], queries.x[i]);
    const float y = gap(box.low[1], box.high[1], queries.y[i], queries.y[i]);
    const float z = gap(box.low[2], box.high[2], queries.z[i], queries.z[i]);
    nearer |= x * x + y * y + z * z < nearest[i];
  }
  return nearer != 0;
}

std::size_t points_within_baseline(const PointBlock* blocks, const std::uint32_t* which,
                                   std::size_t count, const float* query, float squared_radius,
                                   float* squared_distances, std::uint32_t* places) {
  std::size_t size = 0;
  for (std::size_t b = 0; b < count; ++b) {
    const PointBlock& block = blocks[which[b]];
    float squared[block_size];
    for (std::size_t i = 0; i < block_size; ++i) {
      const float x = query[0] - block.x[i], y = query[1] - block.y[i], z = query[2] - block.z[i];
      squared[i] = x * x + y * y + z * z;
    }
    for (std::size_t i = 0; i < block_size; ++i) {
      squared_distances[size] = squared[i];
      places[size] =
          which[b] * static_cast<std::uint32_t>(block_size) + static_cast<std::uint32_t>(i);
      size += squared[i] < squared_radius;
    }
  }
  return size;
}

#if defined(__x86_64__)

/// The lanes that `mask` names, as indices packed to the front.
FUSIONSLAM_AVX2 inline __m256i packed_lanes(unsigned mask) {
  const auto bytes = _pdep_u64(mask, 0x0101010101010101U) * 0xFFU;
  const auto lanes = _pext_u64(0x0706050403020100U, bytes);
  return _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(static_cast<long long>(lanes)));
}

FUSIONSLAM_AVX2 std::size_t points_within_avx2(const PointBlock* blocks, const std::uint32_t* which,
                                               std::size_t count, const float* query,
                                               float squared_radius, float* squared_distances,
                                               std::uint32_t* places) {
  const __m256 qx = _mm256_set1_ps(query[0]), qy = _mm256_set1_ps(query[1]);
  const __m256 qz = _mm256_set1_ps(query[2]), limit = _mm256_set1_ps(squared_radius);
  std::size_t size = 0;
  for (std::size_t b = 0; b < count; ++b) {
    const PointBlock& block = blocks[which[b]];
    for (std::size_t half = 0; half < block_size; half += 8) {
      const __m256 x = _mm256_sub_ps(qx, _mm256_load_ps(block.x + half));
      const __m256 y = _mm256_sub_ps(qy, _mm256_load_ps(block.y + half));
      const __m256 z = _mm256_sub_ps(qz, _mm256_load_ps(block.z + half));
      const __m256 squared = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(x, x), _mm256_mul_ps(y, y)),
                                           _mm256_mul_ps(z, z));
      const auto inside =
          static_cast<unsigned>(_mm256_movemask_ps(_mm256_cmp_ps(squared, limit, _CMP_LT_OQ)));
      const __m256i lanes = packed_lanes(inside);
      const __m256i first = _mm256_set1_epi32(static_cast<int>(which[b] * block_size + half));
      _mm256_storeu_ps(squared_distances + size, _mm256_permutevar8x32_ps(squared, lanes));
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(places + size),
                          _mm256_add_epi32(first, lanes));
      size += static_cast<std::size_t>(_mm_popcnt_u32(inside));
    }
  }
  return size;
}

FUSIONSLAM_AVX512 std::size_t points_within_avx512(const PointBlock* blocks,
                                                   const std::uint32_t* which, std::size_t count,
                                                   const float* query, float squared_radius,
                                                   float* squared_distances,
                                                   std::uint32_t* places) {
  const __m512 qx = _mm512_set1_ps(query[0]), qy = _mm512_set1_ps(query[1]);
  const __m512 qz = _mm512_set1_ps(query[2]), limit = _mm512_set1_ps(squared_radius);
  const __m512i lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  std::size_t size = 0;
  for (std::size_t b = 0; b < count; ++b) {
    const PointBlock& block = blocks[which[b]];
    const __m512 x = _mm512_sub_ps(qx, _mm512_load_ps(block.x));
    const __m512 y = _mm512_sub_ps(qy, _mm512_load_ps(block.y));
    const __m512 z = _mm512_sub_ps(qz, _mm512_load_ps(block.z));
    const __m512 squared =
        _mm512_add_ps(_mm512_add_ps(_mm512_mul_ps(x, x), _mm512_mul_ps(y, y)), _mm512_mul_ps(z, z));
    const __mmask16 inside = _mm512_cmp_ps_mask(squared, limit, _CMP_LT_OQ);
    const __m512i place =
        _mm512_add_epi32(_mm512_set1_epi32(static_cast<int>(which[b] * block_size)), lanes);
    _mm512_storeu_ps(squared_distances + size, _mm512_maskz_compress_ps(inside, squared));
    _mm512_storeu_si512(places + size, _mm512_maskz_compress_epi32(inside, place));
    size += static_cast<std::size_t>(_mm_popcnt_u32(inside));
  }
  return size;
}

#else

constexpr auto points_within_avx2 = points_within_baseline;
constexpr auto points_within_avx512 = points_within_baseline;

#endif

}  // namespace

NeighborKernels neighbor_kernels(SimdLevel level) {
  return {compiled_for<boxes_within>(level),
          choose(level, points_within_baseline, points_within_avx2, points_within_avx512),
          choose(level, Levels<rank<Vectors16>>::baseline, Levels<rank<Vectors32>>::avx2,
                 Levels<rank<Vectors64>>::avx512),
          compiled_for<lower_nearest>(level),
          compiled_for<lower_nearest_in_block>(level),
          compiled_for<any_nearer>(level)};
}

}  // namespace fusionslam::detail
