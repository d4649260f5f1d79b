// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Global Fourier Histogram (Chen et al. 2014).
#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdint>
#include <numbers>
#include <string>

#include "../detail/checks.hpp"
#include "fusionslam/descriptors.hpp"

namespace fusionslam {
namespace {

/// Counts by ring, layer and sector.
std::vector<double> count(PointsView points, const GfhConfig& config) {
  const auto sectors = static_cast<std::size_t>(config.sectors);
  std::vector<double> counts(static_cast<std::size_t>(config.rings) *
                             static_cast<std::size_t>(config.layers) * sectors);
  bool empty = true;
  for (std::size_t i = 0; i < points.size; ++i) {
    const double x = points[i][0], y = points[i][1], z = points[i][2];
    const double ring = std::floor(std::sqrt(x * x + y * y) / config.max_range * config.rings);
    const double layer =
        std::floor((z - config.bottom) / (config.top - config.bottom) * config.layers);
    if (!(ring < config.rings) || !(layer >= 0 && layer < config.layers)) continue;
    const double turn = std::atan2(y, x) / (2 * std::numbers::pi);
    const double sector =
        std::min(std::floor((turn < 0 ? turn + 1 : turn) * config.sectors), config.sectors - 1.0);
    const auto row = static_cast<std::size_t>(ring * config.layers + layer);
    ++counts[row * sectors + static_cast<std::size_t>(sector)];
    empty = false;
  }
  if (empty)
    throw DataError("GFH: the cloud has no point within " + std::to_string(config.max_range) +
                    " m of the vertical axis between " + std::to_string(config.bottom) + " and " +
                    std::to_string(config.top) + " m");
  return counts;
}

/// exp(-2 pi i k / size) for each k.
std::vector<std::complex<double>> roots_of_unity(std::size_t size) {
  std::vector<std::complex<double>> roots(size);
  for (std::size_t k = 0; k < size; ++k)
    roots[k] =
        std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(size));
  return roots;
}

/// Amplitudes of the Fourier transform of each row of `sectors` counts. Rows without a point, most
/// of them, have none.
std::vector<double> amplitudes(const std::vector<double>& counts, std::size_t sectors) {
  const auto roots = roots_of_unity(sectors);
  const std::size_t frequencies = sectors / 2 + 1;
  std::vector<double> result(counts.size() / sectors * frequencies);
  std::vector<std::complex<double>> sums(frequencies);
  for (std::size_t row = 0; row < counts.size() / sectors; ++row) {
    std::ranges::fill(sums, 0);
    for (std::size_t s = 0; s < sectors; ++s)
      if (const double value = counts[row * sectors + s]; value > 0)
        for (std::size_t f = 0; f < frequencies; ++f) sums[f] += value * roots[f * s % sectors];
    for (std::size_t f = 0; f < frequencies; ++f)
      result[row * frequencies + f] = std::sqrt(std::norm(sums[f]));
  }
  return result;
}

}  // namespace

std::vector<float> gfh(PointsView points, const GfhConfig& config) {
  validate(config);
  if (!(config.bottom < config.top))
    throw ConfigError("gfh.top is " + std::to_string(config.top) +
                      ", expected more than gfh.bottom, which is " + std::to_string(config.bottom));
  detail::check_points(points, 1, "GFH");
  const auto values = amplitudes(count(points, config), static_cast<std::size_t>(config.sectors));
  double squares = 0;
  for (const double value : values) squares += value * value;
  std::vector<float> descriptor;
  descriptor.reserve(values.size());
  for (const double value : values)
    descriptor.push_back(static_cast<float>(value / std::sqrt(squares)));
  return descriptor;
}

}  // namespace fusionslam
