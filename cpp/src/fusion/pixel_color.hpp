// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "fusionslam/fusion.hpp"
#include "projection.hpp"

namespace fusionslam::detail {

using Color = std::array<std::uint8_t, 3>;

inline Color color_at(ImageView image, int row, int column) {
  const std::uint8_t* pixel = image.pixel(row, column);
  return image.channels == 3 ? Color{pixel[0], pixel[1], pixel[2]}
                             : Color{pixel[0], pixel[0], pixel[0]};
}

/// Weighted mean of the four pixel centres around (u, v); outside the outermost centres the
/// nearest.
inline Color bilinear_color(ImageView image, double u, double v) {
  u = std::clamp(u, 0.0, image.width - 1.0);
  v = std::clamp(v, 0.0, image.height - 1.0);
  const int column = std::min(static_cast<int>(u), std::max(image.width - 2, 0));
  const int row = std::min(static_cast<int>(v), std::max(image.height - 2, 0));
  const int next_column = std::min(column + 1, image.width - 1);
  const int next_row = std::min(row + 1, image.height - 1);
  const double right = u - column;
  const double down = v - row;
  const Color corners[4] = {color_at(image, row, column), color_at(image, row, next_column),
                            color_at(image, next_row, column),
                            color_at(image, next_row, next_column)};
  const double weights[4] = {(1 - right) * (1 - down), right * (1 - down), (1 - right) * down,
                             right * down};
  Color result{};
  for (std::size_t channel = 0; channel < 3; ++channel) {
    double sum = 0.5;
    for (std::size_t i = 0; i < 4; ++i) sum += weights[i] * corners[i][channel];
    result[channel] = static_cast<std::uint8_t>(sum);
  }
  return result;
}

/// Colour of a visible pixel.
inline Color read_color(ImageView image, const Pixel& pixel, Interpolation interpolation) {
  return interpolation == Interpolation::nearest ? color_at(image, pixel.row(), pixel.column())
                                                 : bilinear_color(image, pixel.u, pixel.v);
}

}  // namespace fusionslam::detail
