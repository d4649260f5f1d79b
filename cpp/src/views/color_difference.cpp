// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "color_difference.hpp"

#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>

#include "../descriptors/color_space.hpp"
#include "fusionslam/errors.hpp"

namespace fusionslam {
namespace {

constexpr double degree = std::numbers::pi / 180;
constexpr double power_25_7 = 6103515625.0;  // 25^7
constexpr double largest_lab = 1e6;          // far beyond any colour; seventh powers are finite

/// A colour in the coordinates of CIEDE2000: chroma and hue of the stretched a (eqs. 4 to 7).
struct Polar {
  double lightness, chroma, hue;
};

/// Near grey a is stretched, the more the lower the mean chroma is (eqs. 2 to 4).
double stretch(double mean_chroma) {
  const double power = std::pow(mean_chroma, 7);
  return 1.5 - 0.5 * std::sqrt(power / (power + power_25_7));
}

Polar polar(const std::array<double, 3>& lab, double a_stretch) {
  const double a = lab[1] * a_stretch;
  const double hue = a == 0 && lab[2] == 0 ? 0 : std::atan2(lab[2], a);
  return {lab[0], std::hypot(a, lab[2]), hue < 0 ? hue + 2 * std::numbers::pi : hue};
}

/// The hue difference on the shorter way; none where one of the colours is grey (eq. 10).
double hue_step(const Polar& a, const Polar& b) {
  if (a.chroma * b.chroma == 0) return 0;
  const double step = b.hue - a.hue;
  if (step > std::numbers::pi) return step - 2 * std::numbers::pi;
  return step < -std::numbers::pi ? step + 2 * std::numbers::pi : step;
}

/// The hue halfway on the shorter way (eq. 14).
double mean_hue(const Polar& a, const Polar& b) {
  const double sum = a.hue + b.hue;
  if (a.chroma * b.chroma == 0) return sum;
  if (std::abs(a.hue - b.hue) <= std::numbers::pi) return sum / 2;
  const double turn = 2 * std::numbers::pi;
  return sum < turn ? (sum + turn) / 2 : (sum - turn) / 2;
}

double hue_weight(double hue) {
  return 1 - 0.17 * std::cos(hue - 30 * degree) + 0.24 * std::cos(2 * hue) +
         0.32 * std::cos(3 * hue + 6 * degree) - 0.20 * std::cos(4 * hue - 63 * degree);
}

/// Coupling of hue and chroma among blues (eqs. 16, 17 and 21).
double rotation(double chroma, double hue) {
  const double offset = (hue / degree - 275) / 25;
  const double power = std::pow(chroma, 7);
  return -std::sin(60 * degree * std::exp(-offset * offset)) * 2 *
         std::sqrt(power / (power + power_25_7));
}

double combine(const Polar& first, const Polar& second) {
  const double lightness = (first.lightness + second.lightness) / 2 - 50;
  const double chroma = (first.chroma + second.chroma) / 2;
  const double hue = mean_hue(first, second);
  const double lightness_scale =
      1 + 0.015 * lightness * lightness / std::sqrt(20 + lightness * lightness);
  const double l = (second.lightness - first.lightness) / lightness_scale;
  const double c = (second.chroma - first.chroma) / (1 + 0.045 * chroma);
  const double h = 2 * std::sqrt(first.chroma * second.chroma) *
                   std::sin(hue_step(first, second) / 2) / (1 + 0.015 * chroma * hue_weight(hue));
  return std::sqrt(l * l + c * c + h * h + rotation(chroma, hue) * c * h);
}

void check_lab(const std::array<double, 3>& lab) {
  for (const double value : lab)
    if (!(std::abs(value) <= largest_lab))
      throw DataError("colour (L, a, b) holds " + std::to_string(value) +
                      ", expected numbers up to 1e6");
}

void check_rgb(const std::array<double, 3>& rgb) {
  for (const double value : rgb)
    if (!(value >= 0 && value <= 255))
      throw DataError("colour (R, G, B) holds " + std::to_string(value) + ", expected 0 to 255");
}

}  // namespace

namespace detail {

std::array<double, 3> color_coordinates(const std::array<double, 3>& rgb, ColorDifference kind) {
  if (kind == ColorDifference::rgb) return rgb;
  if (kind == ColorDifference::author) return {std::sqrt(3.0) * rgb[0], 0, 0};
  return lab_from_rgb(rgb);
}

double coordinate_difference(const std::array<double, 3>& a, const std::array<double, 3>& b,
                             ColorDifference kind) {
  if (kind != ColorDifference::ciede2000) return length_of_difference(a, b);
  const double mean_chroma = (std::hypot(a[1], a[2]) + std::hypot(b[1], b[2])) / 2;
  const double a_stretch = stretch(mean_chroma);
  return combine(polar(a, a_stretch), polar(b, a_stretch));
}

}  // namespace detail

double ciede2000(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  check_lab(a);
  check_lab(b);
  return detail::coordinate_difference(a, b, ColorDifference::ciede2000);
}

double color_difference(const std::array<double, 3>& a, const std::array<double, 3>& b,
                        ColorDifference kind) {
  check_rgb(a);
  check_rgb(b);
  return detail::coordinate_difference(detail::color_coordinates(a, kind),
                                       detail::color_coordinates(b, kind), kind);
}

}  // namespace fusionslam
