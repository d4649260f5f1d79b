// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// LiDAR Iris (Wang, Sun, Xu, Sarma, Yang, Kong, IROS 2020).
#include "fusionslam/descriptors/iris.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <sstream>

#include "../detail/checks.hpp"
#include "polar_grid.hpp"

namespace fusionslam {
namespace {

constexpr int rings = 80;
constexpr int columns = 360;
constexpr int slices = 8;
constexpr int filters = 4;
constexpr int words = rings * filters * 2 / 16;  ///< of a column's code, and of its mask

constexpr double shortest_wavelength = 18;  ///< columns
constexpr double wavelength_ratio = 1.6;    ///< of a filter to the one before
constexpr double bandwidth = 0.75;          ///< ratio of the deviation to the centre frequency
constexpr double weakest_response = 255e-4;

/// Responses are sums of whole numbers: they depend neither on the order nor on the machine, and
/// those of a turned image are the same ones. |255 x 360 x this| fits into 32 bits.
constexpr double kernel_range = 23000;

/// A complex kernel in whole numbers, twice around so that any shift of it is contiguous.
struct Kernel {
  std::array<std::array<std::int16_t, 2 * columns>, 2> parts;
  double weakest_power;  ///< squared response below which its sign says nothing
};

/// The filter exp(-ln(f / centre)^2 / (2 ln(bandwidth)^2)) of frequencies f > 0 alone, which makes
/// its kernel complex, its parts a quarter of a wave apart.
Kernel log_gabor_kernel(double wavelength) {
  std::array<std::array<double, columns>, 2> exact{};
  const double width = std::log(bandwidth);
  for (int f = 1; f < columns / 2; ++f) {
    const double octave = std::log(f * wavelength / columns) / width;
    const double gain = std::exp(-octave * octave / 2) / columns;
    for (int n = 0; n < columns; ++n) {
      const double phase = 2 * std::numbers::pi * (f * n % columns) / columns;
      exact[0][static_cast<std::size_t>(n)] += gain * std::cos(phase);
      exact[1][static_cast<std::size_t>(n)] += gain * std::sin(phase);
    }
  }
  double largest = 0;
  for (const auto& part : exact)
    for (const double value : part) largest = std::max(largest, std::abs(value));
  const double scale = kernel_range / largest;
  Kernel kernel{{}, std::pow(weakest_response * scale, 2)};
  for (std::size_t part = 0; part < 2; ++part)
    for (std::size_t n = 0; n < 2 * columns; ++n)
      kernel.parts[part][n] =
          static_cast<std::int16_t>(std::lround(exact[part][n % columns] * scale));
  return kernel;
}

std::array<Kernel, filters> make_kernels() {
  std::array<Kernel, filters> kernels;
  for (std::size_t i = 0; i < filters; ++i)
    kernels[i] = log_gabor_kernel(shortest_wavelength * std::pow(wavelength_ratio, i));
  return kernels;
}

using Response = std::array<std::int32_t, columns>;

/// Circular convolution of a ring with a part of a kernel.
Response convolve(const std::uint8_t* ring, const std::array<std::int16_t, 2 * columns>& kernel) {
  Response response{};
  for (int column = 0; column < columns; ++column) {
    const std::int32_t value = ring[column];
    if (value == 0) continue;
    const std::int16_t* shifted = kernel.data() + columns - column;
    for (int n = 0; n < columns; ++n) response[static_cast<std::size_t>(n)] += value * shifted[n];
  }
  return response;
}

/// Bits of one column, in words of the row of floats.
struct ColumnBits {
  std::array<std::uint16_t, words> code{};
  std::array<std::uint16_t, words> mask{};
};

void encode_ring(const std::uint8_t* image_ring, int ring,
                 const std::array<Kernel, filters>& kernels, std::vector<ColumnBits>& bits) {
  const auto word = static_cast<std::size_t>(ring / 2);
  for (std::size_t filter = 0; filter < filters; ++filter) {
    const Response real = convolve(image_ring, kernels[filter].parts[0]);
    const Response imaginary = convolve(image_ring, kernels[filter].parts[1]);
    const auto first = static_cast<int>(8 * (ring % 2) + 2 * static_cast<int>(filter));
    for (std::size_t n = 0; n < columns; ++n) {
      const double x = real[n], y = imaginary[n];
      if (x * x + y * y < kernels[filter].weakest_power) continue;
      bits[n].code[word] |= static_cast<std::uint16_t>(((x > 0) | (y > 0) << 1) << first);
      bits[n].mask[word] |= static_cast<std::uint16_t>(3 << first);
    }
  }
}

}  // namespace

std::vector<std::uint8_t> iris_image(PointsView points, const IrisConfig& config) {
  validate(config);
  if (!(config.lowest < config.highest))
    throw ConfigError("iris.lowest is " + std::to_string(config.lowest) +
                      ", expected less than iris.highest, which is " +
                      std::to_string(config.highest));
  detail::check_points(points, 1, "LiDAR Iris");
  const detail::PolarGrid grid{columns, rings, config.max_range};
  std::vector<std::uint8_t> image(grid.size());
  bool empty = true;
  for (std::size_t i = 0; i < points.size; ++i) {
    const double slice =
        std::floor((points[i][2] - config.lowest) / (config.highest - config.lowest) * slices);
    if (!(slice >= 0 && slice < slices)) continue;
    const std::ptrdiff_t bin = grid.bin_of(points[i]);
    if (bin < 0) continue;
    image[static_cast<std::size_t>(bin % rings * columns + bin / rings)] |=
        static_cast<std::uint8_t>(1 << static_cast<int>(slice));
    empty = false;
  }
  if (empty) {
    std::ostringstream message;
    message << "LiDAR Iris: the cloud has no point within iris.max_range, which is "
            << config.max_range << " m, with z from iris.lowest to iris.highest, " << config.lowest
            << " to " << config.highest << " m";
    throw DataError(message.str());
  }
  return image;
}

std::vector<float> iris(PointsView points, const IrisConfig& config) {
  static const std::array<Kernel, filters> kernels = make_kernels();
  const std::vector<std::uint8_t> image = iris_image(points, config);
  std::vector<ColumnBits> bits(columns);
  for (int ring = 0; ring < rings; ++ring)
    encode_ring(image.data() + ring * columns, ring, kernels, bits);
  std::vector<float> row;
  row.reserve(columns * 2 * words);
  for (const ColumnBits& column : bits) {
    row.insert(row.end(), column.code.begin(), column.code.end());
    row.insert(row.end(), column.mask.begin(), column.mask.end());
  }
  return row;
}

}  // namespace fusionslam
