// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace fusionslam {

/// Non-owning view of points: x, y, z as consecutive floats, in metres.
struct PointsView {
  const float* data = nullptr;
  std::size_t size = 0;
  std::size_t stride = 3;  ///< floats from one point to the next

  const float* operator[](std::size_t i) const { return data + i * stride; }
};

/// Non-owning view of 8-bit colours, one a point.
struct ColorsView {
  const std::uint8_t* data = nullptr;  ///< red byte of the first colour
  std::size_t size = 0;
  std::size_t stride = 3;           ///< bytes from one colour to the next
  std::ptrdiff_t channel_step = 1;  ///< bytes from red to green and from green to blue; -1 is BGR

  std::uint8_t at(std::size_t i, int channel) const {
    return data[static_cast<std::ptrdiff_t>(i * stride) + channel * channel_step];
  }
};

/// Non-owning view of an 8-bit image: 1 channel (grey) or 3 (RGB), interleaved.
struct ImageView {
  const std::uint8_t* data = nullptr;
  int width = 0;
  int height = 0;
  int channels = 3;
  std::size_t row_stride = 0;  ///< bytes from one row to the next

  const std::uint8_t* pixel(int row, int column) const {
    return data + static_cast<std::size_t>(row) * row_stride +
           static_cast<std::size_t>(column) * static_cast<std::size_t>(channels);
  }
};

/// Row-major 3x4 matrix that maps homogeneous points to homogeneous pixels.
using Projection = std::array<double, 12>;

/// Row-major 4x4 rigid transform; `a_from_b` maps points in b to points in a.
using Transform = std::array<double, 16>;

inline constexpr Transform identity_transform{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

/// Points with colours, and where each came from.
struct ColoredCloud {
  std::vector<float> points;          ///< x, y, z in metres, size() times
  std::vector<std::uint8_t> colors;   ///< R, G, B, size() times
  std::vector<std::int64_t> indices;  ///< of the input point (or row-major pixel) of each

  std::size_t size() const { return indices.size(); }
  PointsView points_view() const { return {points.data(), points.size() / 3}; }
  ColorsView colors_view() const { return {colors.data(), colors.size() / 3}; }
};

}  // namespace fusionslam
