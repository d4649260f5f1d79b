// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "color_space.hpp"

#include <algorithm>
#include <cmath>

namespace fusionslam::detail {
namespace {

/// The two branches of the sRGB curve for each byte, since a power a point would cost too much.
struct SrgbCurve {
  double low[256], high[256];
  SrgbCurve() {
    for (int i = 0; i < 256; ++i) {
      low[i] = i / 255.0 / 12.92;
      high[i] = std::pow((i / 255.0 + 0.055) / 1.055, 2.4);
    }
  }
};

double srgb_to_linear(std::uint8_t value, double deciding) {
  static const SrgbCurve curve;
  return deciding > 0.04045 ? curve.high[value] : curve.low[value];
}

double srgb_to_linear(double value) {
  return value > 0.04045 ? std::pow((value + 0.055) / 1.055, 2.4) : value / 12.92;
}

double lab_curve(double t) { return t > 0.008856 ? std::cbrt(t) : 7.787 * t + 16.0 / 116.0; }

std::array<double, 3> lab_of_linear(double red, double green, double blue) {
  const double x = lab_curve((red * 41.24 + green * 35.76 + blue * 18.05) / 95.047);
  const double y = lab_curve((red * 21.26 + green * 71.52 + blue * 7.22) / 100.0);
  const double z = lab_curve((red * 1.93 + green * 11.92 + blue * 95.05) / 108.883);
  return {116 * y - 16, 500 * (x - y), 200 * (y - z)};
}

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

std::array<double, 3> grey_world_gains(ColorsView colors) {
  constexpr double common_mean = 110;
  std::array<std::uint64_t, 3> sums{};
  for (std::size_t i = 0; i < colors.size; ++i)
    for (std::size_t channel = 0; channel < 3; ++channel)
      sums[channel] += colors.at(i, static_cast<int>(channel));
  std::array<double, 3> gains{1, 1, 1};
  for (std::size_t channel = 0; channel < 3; ++channel)
    if (sums[channel] > 0)
      gains[channel] =
          common_mean * static_cast<double>(colors.size) / static_cast<double>(sums[channel]);
  return gains;
}

ByteTable scale(const std::array<double, 3>& gains) {
  ByteTable table;
  for (std::size_t channel = 0; channel < 3; ++channel)
    for (std::size_t value = 0; value < 256; ++value)
      table[channel][value] =
          static_cast<std::uint8_t>(std::min(static_cast<double>(value) * gains[channel], 255.0));
  return table;
}

std::array<double, 3> channels(std::array<std::uint8_t, 3> c, ColorSpace space, bool author_lab) {
  if (space == ColorSpace::hsv) return hsv_from_rgb(c[0], c[1], c[2]);
  if (space == ColorSpace::lab) return lab_from_rgb(c[0], c[1], c[2], author_lab);
  return {double(c[0]), double(c[1]), double(c[2])};
}

}  // namespace

ByteTable grey_world(ColorsView colors) { return scale(grey_world_gains(colors)); }

std::array<double, 3> hsv_from_rgb(std::uint8_t r, std::uint8_t g, std::uint8_t b) {
  const double largest = std::max({r, g, b});
  const double range = largest - std::min({r, g, b});
  return {hue_degrees(r, g, b, largest, range) / 360, largest > 0 ? range / largest : 0,
          largest / 255};
}

std::array<double, 3> lab_from_rgb(std::uint8_t r, std::uint8_t g, std::uint8_t b,
                                   bool author_fault) {
  const double red = srgb_to_linear(r, r / 255.0);
  const double green = srgb_to_linear(g, author_fault ? red : g / 255.0);
  const double blue = srgb_to_linear(b, author_fault ? red : b / 255.0);
  const auto [lightness, a, b_star] = lab_of_linear(red, green, blue);
  return {lightness / 100, (a + 128) / 255, (b_star + 128) / 255};
}

std::array<double, 3> lab_from_rgb(const std::array<double, 3>& rgb) {
  return lab_of_linear(srgb_to_linear(rgb[0] / 255), srgb_to_linear(rgb[1] / 255),
                       srgb_to_linear(rgb[2] / 255));
}

ColorBinner::ColorBinner(ColorsView colors, ColorSpace space, const M2dpConfig& config)
    : colors_(colors),
      space_(space),
      config_(config),
      scaled_(config.grey_world ? grey_world(colors) : scale({1, 1, 1})) {
  for (std::size_t channel = 0; channel < 3; ++channel)
    for (std::size_t value = 0; value < 256; ++value)
      rgb_bins_[channel][value] = bin_of(scaled_[channel][value], 255, config.color_bins);
}

void ColorBinner::bins(std::size_t begin, std::size_t count, std::uint8_t* result) const {
  for (std::size_t i = 0; i < count; ++i) {
    const auto byte = [&](std::size_t c) { return colors_.at(begin + i, static_cast<int>(c)); };
    if (space_ == ColorSpace::rgb) {
      for (std::size_t c = 0; c < 3; ++c) result[3 * i + c] = rgb_bins_[c][byte(c)];
      continue;
    }
    const auto value = channels({scaled_[0][byte(0)], scaled_[1][byte(1)], scaled_[2][byte(2)]},
                                space_, config_.author_lab);
    for (std::size_t c = 0; c < 3; ++c) result[3 * i + c] = bin_of(value[c], 1, config_.color_bins);
  }
}

}  // namespace fusionslam::detail
