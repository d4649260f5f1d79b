// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// RING (Lu, Xu, Yin, Chen, Xiong, Wang, IROS 2022).
#include "fusionslam/descriptors/ring.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <sstream>

#include "../detail/checks.hpp"

namespace fusionslam {
namespace {

constexpr int side = 120;  ///< cells, and offsets of the lines
constexpr int angles = 120;
constexpr int frequencies = 60;
constexpr double center = (side - 1) / 2.0;  ///< cells from the centre of the first one

/// Centre of a cell, from that of the image, in cells.
struct Place {
  double x, y;
};

/// The cells with points. Those whose centres lie beyond the lines of some angle are left out, so
/// that a turn neither brings nor takes any.
std::vector<Place> occupied_cells(PointsView points, const RingConfig& config) {
  std::vector<char> image(side * side);
  std::vector<Place> places;
  for (std::size_t i = 0; i < points.size; ++i) {
    if (!(points[i][2] + config.height >= config.least_height)) continue;
    const double row = std::floor((points[i][0] / config.max_range + 1) / 2 * side);
    const double column = std::floor((points[i][1] / config.max_range + 1) / 2 * side);
    const Place place{row - center, column - center};
    if (!(place.x * place.x + place.y * place.y <= center * center)) continue;
    char& cell = image[static_cast<std::size_t>(row * side + column)];
    if (!cell) places.push_back(place);
    cell = 1;
  }
  return places;
}

using Sums = std::array<double, side + 1>;  ///< the last one takes shares of nothing

/// Sums of the cells along the lines of an angle, each cell shared by the two lines about it.
Sums project(const std::vector<Place>& places, double angle) {
  Sums sums{};
  const double x = std::cos(angle), y = std::sin(angle);
  for (const Place& place : places) {
    const double offset = std::clamp(x * place.x + y * place.y + center, 0.0, side - 1.0);
    const auto line = static_cast<std::size_t>(offset);
    const double share = offset - static_cast<double>(line);
    sums[line] += 1 - share;
    sums[line + 1] += share;
  }
  return sums;
}

/// cos and sin of the frequencies 1 to 60 at each offset.
struct Waves {
  std::array<std::array<double, frequencies>, side> cosines, sines;
};

Waves make_waves() {
  Waves waves;
  for (std::size_t n = 0; n < side; ++n)
    for (std::size_t k = 0; k < frequencies; ++k) {
      const double phase = 2 * std::numbers::pi * static_cast<double>((k + 1) * n % side) / side;
      waves.cosines[n][k] = std::cos(phase);
      waves.sines[n][k] = std::sin(phase);
    }
  return waves;
}

void write_amplitudes(const Sums& sums, const Waves& waves, float* amplitudes) {
  std::array<double, frequencies> real{}, imaginary{};
  for (std::size_t n = 0; n < side; ++n)
    for (std::size_t k = 0; k < frequencies; ++k) {
      real[k] += sums[n] * waves.cosines[n][k];
      imaginary[k] += sums[n] * waves.sines[n][k];
    }
  for (std::size_t k = 0; k < frequencies; ++k)
    amplitudes[k] = static_cast<float>(std::sqrt(real[k] * real[k] + imaginary[k] * imaginary[k]));
}

}  // namespace

std::vector<float> ring(PointsView points, const RingConfig& config) {
  static const Waves waves = make_waves();
  validate(config);
  detail::check_points(points, 1, "RING");
  const std::vector<Place> places = occupied_cells(points, config);
  if (places.empty()) {
    std::ostringstream message;
    message << "RING: the cloud has no point within ring.max_range, which is " << config.max_range
            << " m, at ring.least_height or higher above the ground, which is "
            << config.least_height << " m";
    throw DataError(message.str());
  }
  std::vector<float> amplitudes(angles * frequencies);
  for (int angle = 0; angle < angles; ++angle)
    write_amplitudes(project(places, std::numbers::pi * angle / angles), waves,
                     amplitudes.data() + angle * frequencies);
  return amplitudes;
}

}  // namespace fusionslam
