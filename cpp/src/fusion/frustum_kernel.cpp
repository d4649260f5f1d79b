// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "frustum_kernel.hpp"

namespace fusionslam::detail {
namespace {

FUSIONSLAM_INLINE std::int32_t magnitude_bits(float value) {
  return __builtin_bit_cast(std::int32_t, value) & INT32_MAX;
}

FUSIONSLAM_INLINE float absolute(float value) { return value < 0 ? -value : value; }

/// Bits of magnitudes are ordered like the magnitudes.
FUSIONSLAM_INLINE std::int32_t largest_bits(const CoordinateBlock& b, std::size_t size) {
  std::int32_t largest = 0;
  for (std::size_t i = 0; i < size; ++i) {
    const std::int32_t x = magnitude_bits(b.x[i]), y = magnitude_bits(b.y[i]);
    const std::int32_t z = magnitude_bits(b.z[i]);
    const std::int32_t xy = x > y ? x : y;
    const std::int32_t all = xy > z ? xy : z;
    largest = all > largest ? all : largest;
  }
  return largest;
}

/// Bound of the rounding error of a point's value: of the sides and of four products and sums.
FUSIONSLAM_INLINE float margin(const float* side, float largest) {
  const float terms = (absolute(side[0]) + absolute(side[1]) + absolute(side[2])) * largest;
  return 1e-6F * (terms + absolute(side[3]));
}

FUSIONSLAM_INLINE int list_inside(RawPoints points, const Frustum& frustum, int* list,
                                  std::int32_t& largest) {
  CoordinateBlock b;
  const std::size_t size = load(points, 0, b);
  largest = largest_bits(b, size);
  const float reach = __builtin_bit_cast(float, largest);
  float slack[4];
  for (int k = 0; k < 4; ++k) slack[k] = frustum.sides[k][3] + margin(frustum.sides[k], reach);

  alignas(64) float inside[point_block];
  const auto& s = frustum.sides;
  for (std::size_t i = 0; i < size; ++i) {
    const float x = b.x[i], y = b.y[i], z = b.z[i];
    const float left = s[0][0] * x + s[0][1] * y + s[0][2] * z + slack[0];
    const float right = s[1][0] * x + s[1][1] * y + s[1][2] * z + slack[1];
    const float top = s[2][0] * x + s[2][1] * y + s[2][2] * z + slack[2];
    const float bottom = s[3][0] * x + s[3][1] * y + s[3][2] * z + slack[3];
    // A sum that overflowed to NaN is never the smaller one, and so excludes nothing.
    const float across = right < left ? right : left;
    const float up = bottom < top ? bottom : top;
    inside[i] = up < across ? up : across;
  }
  int count = 0;
  for (std::size_t i = 0; i < size; ++i) {
    list[count] = static_cast<int>(i);
    count += !(inside[i] < 0);
  }
  return count;
}

}  // namespace

ListInside* frustum_kernel(SimdLevel level) { return compiled_for<list_inside>(level); }

}  // namespace fusionslam::detail
