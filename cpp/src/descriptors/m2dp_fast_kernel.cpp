// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Neither sqrt nor atan2: the ring follows from the squared radius, the sector from signs that
// fold the circle three times (half, quadrant, octant), which makes its code a Gray code.
// A ring's shape and colour counters share a cache line, so that a coloured vote is one vector
// addition; eight planes take turns, so that additions to one line do not wait for one another.
#include "m2dp_fast_kernel.hpp"

#if defined(__x86_64__)
#pragma GCC diagnostic push  // a false alarm of GCC 12 inside the header
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>
#pragma GCC diagnostic pop
#endif

namespace fusionslam::detail {
namespace {

constexpr int lanes = 16;  // points placed at a time
constexpr int sign_bit = INT32_MIN;
constexpr float tangent = 0.41421356237309503f;  // of 22.5 degrees

/// Squared inner radii of rings 1 to 7: (i / 8)^4, exact in float.
constexpr float ring_edge(int i) {
  return static_cast<float>(i * i * i * i) / (fast_rings * fast_rings * fast_rings * fast_rings);
}

/// ring * 16 + sector code, in whatever type a level packs them fastest.
template <class Code>
using Codes = Code[fast_group][lanes];

FUSIONSLAM_INLINE std::int32_t bits(float value) { return __builtin_bit_cast(std::int32_t, value); }
FUSIONSLAM_INLINE float as_float(std::int32_t value) { return __builtin_bit_cast(float, value); }

/// Places 16 points on one plane.
FUSIONSLAM_INLINE void place(const float* x, const float* y, const float* z, const FastPlane& plane,
                             std::uint32_t* codes) {
  const float a0 = plane.minus_x_axis[0], a1 = plane.minus_x_axis[1], a2 = plane.minus_x_axis[2];
  const float b1 = plane.y_axis[0], b2 = plane.y_axis[1];
  for (int i = 0; i < lanes; ++i) {
    const float u = x[i] * a0 + y[i] * a1 + z[i] * a2;  // minus x
    const float v = (y[i] * b1 + z[i] * b2) + 0.0f;     // adding 0 makes -0 a 0
    const float squared = u * u + v * v;
    std::int32_t ring = 0;
    for (int k = 1; k < fast_rings; ++k) ring += squared >= ring_edge(k) ? 16 : 0;

    const std::int32_t lower = bits(v) & sign_bit;  // the lower half is turned onto the upper one
    const std::int32_t w = bits(as_float(bits(u) ^ lower) + 0.0f);
    const std::int32_t across = w & ~sign_bit, up = bits(v) & ~sign_bit;
    // Negative past the diagonal; on it only in the quadrant where it is entered there.
    const std::int32_t diagonal = across + (w >> 31) - up;
    const float larger = as_float(across) > as_float(up) ? as_float(across) : as_float(up);
    const float smaller = as_float(across) > as_float(up) ? as_float(up) : as_float(across);
    const std::int32_t half_octant = bits(smaller - tangent * larger);
    const auto sector = (static_cast<std::uint32_t>(lower) >> 28) |
                        ((static_cast<std::uint32_t>(w) >> 31) << 2) |
                        ((static_cast<std::uint32_t>(diagonal) >> 31) << 1) |
                        (static_cast<std::uint32_t>(half_octant) >> 31);
    codes[i] = static_cast<std::uint32_t>(ring) + sector;
  }
}

template <int Row>
using Counters = std::uint8_t[fast_group][fast_rings * Row];

template <class Code>
FUSIONSLAM_INLINE void vote(const Codes<Code>& codes, int count, const FastBlock&, std::size_t,
                            Counters<fast_shape_row>& counters) {
  for (int i = 0; i < count; ++i)
    for (std::size_t p = 0; p < fast_group; ++p) ++counters[p][codes[p][i]];
}

using Line = std::uint8_t __attribute__((vector_size(fast_color_row), may_alias));

struct SectorLines {
  alignas(64) std::uint8_t lines[fast_sectors][fast_color_row] = {};
  constexpr SectorLines() {
    for (int i = 0; i < fast_sectors; ++i) lines[i][i] = 1;
  }
};
constexpr SectorLines sector_lines;

template <class Code>
FUSIONSLAM_INLINE void vote(const Codes<Code>& codes, int count, const FastBlock& block,
                            std::size_t first, Counters<fast_color_row>& counters) {
  for (int i = 0; i < count; ++i) {
    const auto* color =
        reinterpret_cast<const Line*>(block.color_rows[first + static_cast<std::size_t>(i)]);
    for (std::size_t p = 0; p < fast_group; ++p) {
      const std::uint32_t code = codes[p][i];
      auto* line = reinterpret_cast<Line*>(counters[p] + (code & 0xf0) * (fast_color_row / 16));
      *line += *color + *reinterpret_cast<const Line*>(sector_lines.lines[code & 0xf]);
    }
  }
}

FUSIONSLAM_INLINE int at_most_lanes(const FastBlock& block, std::size_t first) {
  return static_cast<int>(block.size - first < lanes ? block.size - first : lanes);
}

template <int Row>
FUSIONSLAM_INLINE void add(const Counters<Row>& counters, std::uint16_t* votes) {
  const std::uint8_t* bytes = counters[0];
  for (std::size_t i = 0; i < fast_group * fast_rings * Row; ++i)
    votes[i] = static_cast<std::uint16_t>(votes[i] + bytes[i]);
}

template <int Row>
FUSIONSLAM_INLINE void count(const FastBlock& block, const FastPlane* planes,
                             std::uint16_t* votes) {
  alignas(64) Counters<Row> counters = {};
  alignas(64) Codes<std::uint32_t> codes;
  for (std::size_t i = 0; i < block.size; i += lanes) {
    for (std::size_t p = 0; p < fast_group; ++p)
      place(block.x + i, block.y + i, block.z + i, planes[p], codes[p]);
    vote(codes, at_most_lanes(block, i), block, i, counters);
  }
  add<Row>(counters, votes);
}

#if defined(__x86_64__)

/// Each power of two of the squared radius holds at most one ring edge: the exponent gives the
/// ring below the edge, times 16, and the edge to compare with.
struct RingTable {
  alignas(64) float edges[lanes] = {};
  alignas(64) std::int32_t rings[lanes] = {};
  constexpr RingTable() {
    float lower = 0x1p-15f;
    for (int exponent = -15; exponent <= 0; ++exponent, lower *= 2) {
      int ring = 0;
      while (ring + 1 < fast_rings && lower >= ring_edge(ring + 1)) ++ring;
      const int place = (127 + exponent) % lanes;
      rings[place] = ring * 16;
      edges[place] = ring + 1 < fast_rings ? ring_edge(ring + 1) : 4;
    }
  }
};
constexpr RingTable ring_table;

/// 16 * ring of squared radii.
FUSIONSLAM_INLINE FUSIONSLAM_AVX512 __m512i rings(__m512 squared) {
  const __m512 clamped =
      _mm512_min_ps(_mm512_max_ps(squared, _mm512_set1_ps(0x1p-14f)), _mm512_set1_ps(1.5f));
  const __m512i exponent = _mm512_srli_epi32(_mm512_castps_si512(clamped), 23);
  const __m512 edge = _mm512_permutexvar_ps(exponent, _mm512_load_ps(ring_table.edges));
  const __m512i ring = _mm512_permutexvar_epi32(exponent, _mm512_load_si512(ring_table.rings));
  const __mmask16 past = _mm512_cmp_ps_mask(clamped, edge, _CMP_GE_OQ);
  return _mm512_mask_add_epi32(ring, past, ring, _mm512_set1_epi32(16));
}

/// a where the mask has ones, b elsewhere.
FUSIONSLAM_INLINE FUSIONSLAM_AVX512 __m512i select(__m512i mask, __m512i a, __m512i b) {
  return _mm512_ternarylogic_epi32(mask, a, b, 0xCA);
}

/// As the portable place(), step by step.
FUSIONSLAM_INLINE FUSIONSLAM_AVX512 void place(__m512 x, __m512 y, __m512 z, const FastPlane& plane,
                                               std::uint8_t* codes) {
  const __m512i sign = _mm512_set1_epi32(sign_bit);
  const __m512 zero = _mm512_setzero_ps();
  const __m512 u =
      _mm512_add_ps(_mm512_add_ps(_mm512_mul_ps(x, _mm512_set1_ps(plane.minus_x_axis[0])),
                                  _mm512_mul_ps(y, _mm512_set1_ps(plane.minus_x_axis[1]))),
                    _mm512_mul_ps(z, _mm512_set1_ps(plane.minus_x_axis[2])));
  const __m512 v = _mm512_add_ps(_mm512_add_ps(_mm512_mul_ps(y, _mm512_set1_ps(plane.y_axis[0])),
                                               _mm512_mul_ps(z, _mm512_set1_ps(plane.y_axis[1]))),
                                 zero);
  const __m512i ring = rings(_mm512_add_ps(_mm512_mul_ps(u, u), _mm512_mul_ps(v, v)));

  const __m512i v_bits = _mm512_castps_si512(v);
  const __m512i turned =  // u ^ (v & sign)
      _mm512_ternarylogic_epi32(_mm512_castps_si512(u), v_bits, sign, 0x78);
  const __m512i w = _mm512_castps_si512(_mm512_add_ps(_mm512_castsi512_ps(turned), zero));
  const __m512i across = _mm512_andnot_si512(sign, w);
  const __m512i up = _mm512_andnot_si512(sign, v_bits);
  const __m512i diagonal = _mm512_sub_epi32(_mm512_add_epi32(across, _mm512_srai_epi32(w, 31)), up);
  const __m512 larger = _mm512_max_ps(_mm512_castsi512_ps(across), _mm512_castsi512_ps(up));
  const __m512 smaller = _mm512_min_ps(_mm512_castsi512_ps(across), _mm512_castsi512_ps(up));
  const __m512i half_octant =
      _mm512_castps_si512(_mm512_sub_ps(smaller, _mm512_mul_ps(_mm512_set1_ps(tangent), larger)));

  const __m512i first_two = select(sign, v_bits, _mm512_srli_epi32(w, 1));
  const __m512i last_two = select(sign, diagonal, _mm512_srli_epi32(half_octant, 1));
  const __m512i sector = select(_mm512_set1_epi32(static_cast<int>(0xC0000000)), first_two,
                                _mm512_srli_epi32(last_two, 2));
  _mm_store_si128(reinterpret_cast<__m128i*>(codes),
                  _mm512_cvtepi32_epi8(_mm512_or_si512(ring, _mm512_srli_epi32(sector, 28))));
}

template <int Row>
FUSIONSLAM_INLINE FUSIONSLAM_AVX512 void count_avx512(const FastBlock& block,
                                                      const FastPlane* planes,
                                                      std::uint16_t* votes) {
  alignas(64) Counters<Row> counters = {};
  alignas(64) Codes<std::uint8_t> codes;
  for (std::size_t i = 0; i < block.size; i += lanes) {
    const __m512 x = _mm512_load_ps(block.x + i);
    const __m512 y = _mm512_load_ps(block.y + i);
    const __m512 z = _mm512_load_ps(block.z + i);
    for (std::size_t p = 0; p < fast_group; ++p) place(x, y, z, planes[p], codes[p]);
    vote(codes, at_most_lanes(block, i), block, i, counters);
  }
  add<Row>(counters, votes);
}

#else
template <int Row>
constexpr auto* count_avx512 = count<Row>;
#endif

template <int Row>
auto* count_for(SimdLevel level) {
  using Portable = Levels<count<Row>>;
  return choose(level, Portable::baseline, Portable::avx2, Levels<count_avx512<Row>>::avx512);
}

}  // namespace

FastKernel fast_kernel(SimdLevel level) {
  return {count_for<fast_shape_row>(level), count_for<fast_color_row>(level)};
}

int fast_sector_code(int sector) {
  constexpr int codes_of_half[] = {0b101, 0b100, 0b110, 0b111, 0b011, 0b010, 0b000, 0b001};
  return (sector < fast_sectors / 2 ? 8 : 0) + codes_of_half[sector % (fast_sectors / 2)];
}

}  // namespace fusionslam::detail
