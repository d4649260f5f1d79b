// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "color_space.hpp"

#include <algorithm>
#include <cmath>

namespace fusionslam::detail {
namespace {

double srgb_to_linear(double value, double deciding) {
  return deciding > 0.04045 ? std::pow((value + 0.055) / 1.055, 2.4) : value / 12.92;
}

double lab_curve(double t) { return t > 0.008856 ? std::cbrt(t) : 7.787 * t + 16.0 / 116.0; }

double hue_degrees(double r, double g, double b, double largest, double range) {
  if (range == 0) return 0;
  double hue = 0;
  if (largest == r)
    hue = 60 * ((g - b) / range);
  else if (largest == g)
    hue = 60 * ((b - r) / range) + 120;
  else
    hue = 60 * ((r - g) / range) + 240;
  return hue < 0 ? hue + 360 : hue;
}

std::uint8_t bin_of(double value, double range, int bins) {
  const double width = range / bins + 0.001;
  return static_cast<std::uint8_t>(
      std::clamp(static_cast<int>(std::floor(value / width)), 0, bins - 1));
}

/// Gains that bring the mean of each channel to the same value (the grey-world assumption of
/// Buchsbaum 1980), which cancels exposure and tint.
std::array<double, 3> grey_world_gains(ColorsView colors) {
  constexpr double common_mean = 110;
  std::array<double, 3> gains{};
  for (int channel = 0; channel < 3; ++channel) {
    double sum = 0;
    for (std::size_t i = 0; i < colors.size; ++i) sum += colors.at(i, channel);
    gains[static_cast<std::size_t>(channel)] =
        sum > 0 ? common_mean * static_cast<double>(colors.size) / sum : 1;
  }
  return gains;
}

std::array<double, 3> channels(std::array<std::uint8_t, 3> c, ColorSpace space, bool author_lab) {
  if (space == ColorSpace::hsv) return hsv_from_rgb(c[0], c[1], c[2]);
  if (space == ColorSpace::lab) return lab_from_rgb(c[0], c[1], c[2], author_lab);
  return {double(c[0]), double(c[1]), double(c[2])};
}

}  // namespace

std::array<double, 3> hsv_from_rgb(std::uint8_t r, std::uint8_t g, std::uint8_t b) {
  const double largest = std::max({r, g, b});
  const double range = largest - std::min({r, g, b});
  return {hue_degrees(r, g, b, largest, range) / 360, largest > 0 ? range / largest : 0,
          largest / 255};
}

std::array<double, 3> lab_from_rgb(std::uint8_t r, std::uint8_t g, std::uint8_t b,
                                   bool author_fault) {
  const double red = srgb_to_linear(r / 255.0, r / 255.0);
  const double green = srgb_to_linear(g / 255.0, author_fault ? red : g / 255.0);
  const double blue = srgb_to_linear(b / 255.0, author_fault ? red : b / 255.0);
  const double x = lab_curve((red * 41.24 + green * 35.76 + blue * 18.05) / 95.047);
  const double y = lab_curve((red * 21.26 + green * 71.52 + blue * 7.22) / 100.0);
  const double z = lab_curve((red * 1.93 + green * 11.92 + blue * 95.05) / 108.883);
  return {(116 * y - 16) / 100, (500 * (x - y) + 128) / 255, (200 * (y - z) + 128) / 255};
}

std::vector<std::uint8_t> color_bins(ColorsView colors, ColorSpace space,
                                     const M2dpConfig& config) {
  const auto gains = config.grey_world ? grey_world_gains(colors) : std::array<double, 3>{1, 1, 1};
  const double range = space == ColorSpace::rgb ? 255 : 1;
  std::vector<std::uint8_t> result(colors.size * 3);
  for (std::size_t i = 0; i < colors.size; ++i) {
    std::array<std::uint8_t, 3> color{};
    for (std::size_t c = 0; c < 3; ++c)
      color[c] =
          static_cast<std::uint8_t>(std::min(colors.at(i, static_cast<int>(c)) * gains[c], 255.0));
    const auto value = channels(color, space, config.author_lab);
    for (std::size_t c = 0; c < 3; ++c)
      result[i * 3 + c] = bin_of(value[c], range, config.color_bins);
  }
  return result;
}

}  // namespace fusionslam::detail
