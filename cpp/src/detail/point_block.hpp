// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Blocks of points with one array a coordinate, in which kernels read clouds.
#pragma once

#include <cstddef>

#include "simd.hpp"

namespace fusionslam::detail {

/// Points of three floats, `stride` floats apart.
struct RawPoints {
  const float* data;
  std::size_t stride;
  std::size_t size;
};

constexpr std::size_t point_block = 256;

struct CoordinateBlock {
  alignas(64) float x[point_block], y[point_block], z[point_block];
};

template <std::size_t Stride>
FUSIONSLAM_INLINE void take_apart(const float* data, std::size_t count, CoordinateBlock& block) {
  for (std::size_t i = 0; i < count; ++i) {
    block.x[i] = data[i * Stride];
    block.y[i] = data[i * Stride + 1];
    block.z[i] = data[i * Stride + 2];
  }
}

/// Reads the points from `begin` on; returns how many they are.
FUSIONSLAM_INLINE std::size_t load(RawPoints points, std::size_t begin, CoordinateBlock& block) {
  const std::size_t rest = points.size - begin;
  const std::size_t count = rest < point_block ? rest : point_block;
  const float* data = points.data + begin * points.stride;
  if (points.stride == 3) {
    take_apart<3>(data, count, block);
  } else if (points.stride == 4) {
    take_apart<4>(data, count, block);
  } else {
    for (std::size_t i = 0; i < count; ++i) {
      block.x[i] = data[i * points.stride];
      block.y[i] = data[i * points.stride + 1];
      block.z[i] = data[i * points.stride + 2];
    }
  }
  return count;
}

}  // namespace fusionslam::detail
