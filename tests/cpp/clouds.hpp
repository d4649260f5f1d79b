// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
/// Made-up clouds and other things that several tests need.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "fusionslam/sensors.hpp"

namespace fusionslam::testing {

struct Cloud {
  std::vector<float> points;
  std::vector<std::uint8_t> colors;

  PointsView points_view() const { return {points.data(), points.size() / 3}; }
  ColorsView colors_view() const { return {colors.data(), colors.size() / 3}; }
};

/// A cloud without any symmetry whose three principal axes differ clearly in length.
inline Cloud random_cloud(std::size_t size, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::uniform_int_distribution<int> byte(0, 255);
  Cloud cloud;
  for (std::size_t i = 0; i < size; ++i) {
    const double x = uniform(random), y = uniform(random), z = uniform(random);
    for (const double value : {30 * x * x, 12 * y * std::sqrt(x), 5 * z * z * (1 - 0.7 * y)})
      cloud.points.push_back(static_cast<float>(value));
    for (const double value : {x, y * z, 1 - z})
      cloud.colors.push_back(static_cast<std::uint8_t>(0.5 * byte(random) + 127 * value));
  }
  return cloud;
}

using Rotation = std::array<double, 9>;

/// Rotation by `angle` about a fixed skew axis (Rodrigues).
inline Rotation rotation(double angle) {
  const double x = 2.0 / 7, y = 3.0 / 7, z = 6.0 / 7, c = std::cos(angle), s = std::sin(angle);
  const double d = 1 - c;
  return {c + x * x * d,     x * y * d - z * s, x * z * d + y * s, y * x * d + z * s, c + y * y * d,
          y * z * d - x * s, z * x * d - y * s, z * y * d + x * s, c + z * z * d};
}

inline Cloud transform(const Cloud& cloud, const Rotation& r, const std::array<double, 3>& shift) {
  Cloud result{{}, cloud.colors};
  for (std::size_t i = 0; i + 2 < cloud.points.size(); i += 3)
    for (std::size_t row = 0; row < 3; ++row) {
      double value = shift[row];
      for (std::size_t column = 0; column < 3; ++column)
        value += r[3 * row + column] * cloud.points[i + column];
      result.points.push_back(static_cast<float>(value));
    }
  return result;
}

/// The same points in rows of `stride` floats, the rest of each row filled with NaN.
inline std::vector<float> strided(const Cloud& cloud, std::size_t stride) {
  std::vector<float> values(cloud.points.size() / 3 * stride, std::nanf(""));
  for (std::size_t i = 0; i < cloud.points.size(); ++i)
    values[i / 3 * stride + i % 3] = cloud.points[i];
  return values;
}

inline double distance(const std::vector<float>& a, const std::vector<float>& b) {
  double sum = a.size() == b.size() ? 0 : 1e9;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
    sum += std::pow(static_cast<double>(a[i]) - static_cast<double>(b[i]), 2);
  return std::sqrt(sum);
}

}  // namespace fusionslam::testing
