// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "lab_distance.hpp"

#include <algorithm>
#include <cmath>

namespace fusionslam::detail {
namespace {

constexpr std::size_t steps = 4000;

/// sRGB to linear light (IEC 61966-2-1).
float linear_light(float value) {
  return value > 0.04045 ? std::pow((value + 0.055F) / 1.055F, 2.4F) : value / 12.92F;
}

/// f of CIE L*a*b*, with PCL's 7.87 where the standard has 7.787.
float lab_curve(float ratio) {
  return ratio > 0.008856F ? std::pow(ratio, 1.0F / 3.0F) : 7.87F * ratio + 16.0F / 116.0F;
}

/// The tables that PCL looks colours up in. White is one step beyond its second one, where it finds
/// the first entry of another table, 0; descriptors of clouds with white points are as they are
/// because of this.
struct Tables {
  std::array<float, 256> linear{};
  std::array<float, steps + 1> curve{};

  Tables() {
    for (std::size_t i = 0; i < linear.size(); ++i)
      linear[i] = linear_light(static_cast<float>(i) / 255.0F);
    for (std::size_t i = 0; i < steps; ++i)
      curve[i] = lab_curve(static_cast<float>(i) / static_cast<float>(steps));
  }
};

const Tables& tables() {
  static const Tables all;
  return all;
}

float limit(float value) { return std::clamp(value, -120.0F, 120.0F); }

}  // namespace

std::array<float, 3> LabDistance::lab(std::array<std::uint8_t, 3> rgb) {
  const Tables& all = tables();
  const float r = all.linear[rgb[0]], g = all.linear[rgb[1]], b = all.linear[rgb[2]];
  const auto curve = [&](float ratio) {
    return all.curve[static_cast<std::size_t>(ratio * static_cast<float>(steps))];
  };
  const float x = curve((r * 0.412453F + g * 0.357580F + b * 0.180423F) / 0.95047F);
  const float y = curve(r * 0.212671F + g * 0.715160F + b * 0.072169F);
  const float z = curve((r * 0.019334F + g * 0.119193F + b * 0.950227F) / 1.08883F);
  return {std::min(116 * y - 16, 100.0F) / 100, limit(500 * (x - y)) / 120,
          limit(200 * (y - z)) / 120};
}

float LabDistance::operator()(std::array<std::uint8_t, 3> color) const {
  const auto to = lab(color);
  const float lightness = std::abs(from_[0] - to[0]);
  return (lightness + (std::abs(from_[1] - to[1]) + std::abs(from_[2] - to[2])) / 2) / 3;
}

}  // namespace fusionslam::detail
