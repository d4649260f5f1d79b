// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Amplitude spectrum of bird's-eye images over direction (after Reddy, Chatterji, IEEE Transactions
// on Image Processing 1996).
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

#include "../detail/checks.hpp"
#include "../detail/opencv.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/matching.hpp"

namespace fusionslam {
namespace {

constexpr int directions = static_cast<int>(scan_context_sectors);
constexpr int frequencies = 24;  ///< multiples of a period in 64 cells
constexpr int layers = 3;
constexpr int rows = layers * frequencies;

/// Heights above the ground at which layers begin, cells.
constexpr std::array<double, layers> layer_bottoms{0.25, 0.75, 1.5};

/// Cells beyond are left out, so that few come and go as the sensor moves.
constexpr double radius = 27.5;

/// The image is wider than what is drawn, so that its spectrum is sampled more finely.
constexpr int side = 128;
constexpr int samples_a_frequency = side / 64;

/// Samples of a spectrum that directions reach, on either side of 0 in x and beyond it in y.
constexpr int reach = frequencies * samples_a_frequency + 1;

/// Standard deviation, cells: points near the border of a cell may fall on either side.
constexpr double blur = 0.7;

using Image = std::vector<float>;

/// The images of the layers, 1 in cells with points. Throws DataError if there is none.
std::array<Image, layers> draw(PointsView points, const BevSpectrumConfig& config) {
  std::array<Image, layers> images;
  images.fill(Image(side * side));
  bool empty = true;
  for (std::size_t i = 0; i < points.size; ++i) {
    const double x = points[i][0] / config.cell, y = points[i][1] / config.cell;
    const double z = (points[i][2] + config.height) / config.cell;
    if (!(z > layer_bottoms[0]) || !(x * x + y * y < radius * radius)) continue;
    const auto layer = std::ranges::lower_bound(layer_bottoms, z) - layer_bottoms.begin() - 1;
    const int row = static_cast<int>(std::floor(x)) + side / 2;
    const int column = static_cast<int>(std::floor(y)) + side / 2;
    images[static_cast<std::size_t>(layer)][static_cast<std::size_t>(row * side + column)] = 1;
    empty = false;
  }
  if (empty)
    throw DataError("bev_spectrum: the cloud has no point higher than " +
                    std::to_string(layer_bottoms[0] * config.cell) + " m above the ground within " +
                    std::to_string(radius * config.cell) + " m");
  return images;
}

/// log(1 + amplitude) of the frequencies (x in rows, y in columns, wrapped around) of an image,
/// within reach.
Image log_spectrum(Image& image) {
  cv::Mat spectrum;
  cv::dft(cv::Mat(side, side, CV_32F, image.data()), spectrum, cv::DFT_COMPLEX_OUTPUT);
  std::array<double, side> gain;
  for (int k = 0; k < side; ++k) {
    const double frequency = std::min(k, side - k) / static_cast<double>(side);
    gain[static_cast<std::size_t>(k)] =
        std::exp(-2 * std::pow(std::numbers::pi * blur * frequency, 2));
  }
  Image logarithms(image.size());
  for (int k = -reach; k <= reach; ++k) {
    const auto row = static_cast<std::size_t>(k & (side - 1));
    const auto* values = spectrum.ptr<cv::Vec2f>(static_cast<int>(row));
    for (std::size_t column = 0; column <= reach; ++column) {
      const double amplitude = std::hypot(values[column][0], values[column][1]);
      logarithms[row * side + column] =
          static_cast<float>(std::log1p(gain[row] * gain[column] * amplitude));
    }
  }
  return logarithms;
}

/// Value between the samples of a spectrum, bilinear.
double interpolate(const Image& spectrum, double x, double y) {
  const double left = std::floor(x), low = std::floor(y);
  const auto at = [&](int row, int column) {
    const int wrapped = ((static_cast<int>(left) + row) & (side - 1)) * side +
                        ((static_cast<int>(low) + column) & (side - 1));
    return static_cast<double>(spectrum[static_cast<std::size_t>(wrapped)]);
  };
  const double u = x - left, v = y - low;
  return (1 - u) * ((1 - v) * at(0, 0) + v * at(0, 1)) + u * ((1 - v) * at(1, 0) + v * at(1, 1));
}

/// Writes the spectrum of a layer, over direction, into the layer's rows of each direction.
void write_polar(const Image& spectrum, int layer, float* descriptor) {
  for (int direction = 0; direction < directions; ++direction) {
    const double angle = std::numbers::pi * direction / directions;
    const double x = samples_a_frequency * std::cos(angle);
    const double y = samples_a_frequency * std::sin(angle);
    float* column = descriptor + direction * rows + layer * frequencies;
    for (int k = 1; k <= frequencies; ++k)
      column[k - 1] = static_cast<float>(interpolate(spectrum, k * x, k * y));
  }
}

/// What all directions share says nothing of the place: how much is seen, and the blur.
void remove_row_means(float* descriptor) {
  for (int row = 0; row < rows; ++row) {
    double sum = 0;
    for (int d = 0; d < directions; ++d) sum += descriptor[d * rows + row];
    for (int d = 0; d < directions; ++d)
      descriptor[d * rows + row] -= static_cast<float>(sum / directions);
  }
}

void normalize_columns(float* descriptor) {
  for (int d = 0; d < directions; ++d) {
    float* column = descriptor + d * rows;
    double squares = 0;
    for (int row = 0; row < rows; ++row) squares += static_cast<double>(column[row]) * column[row];
    if (squares > 0)
      for (int row = 0; row < rows; ++row)
        column[row] = static_cast<float>(column[row] / std::sqrt(squares));
  }
}

/// Metres: what is near, with more points, does not count for more.
constexpr double column_side = 0.5;

/// Share of the columns within range, and of those whose lowest point is below the ground.
constexpr double share_within = 0.99, share_below = 0.25;

/// The widest cell, metres, in steps of the root of 2, so that clouds of one building fit the same.
constexpr double widest = 2;
constexpr int smallest_step = -8;

/// What a share of some values is below.
double quantile(std::vector<double>& values, double share) {
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::ranges::nth_element(values, at);
  return *at;
}

}  // namespace

BevSpectrumConfig fit_bev_spectrum(PointsView points) {
  detail::check_points(points, 1, "fit_bev_spectrum");
  std::map<std::pair<double, double>, double> lowest;
  for (std::size_t i = 0; i < points.size; ++i) {
    const double z = points[i][2];
    const std::pair column{std::floor(points[i][0] / column_side),
                           std::floor(points[i][1] / column_side)};
    const auto [found, is_new] = lowest.try_emplace(column, z);
    if (!is_new) found->second = std::min(found->second, z);
  }
  std::vector<double> distances, heights;
  for (const auto& [column, z] : lowest) {
    distances.push_back(column_side * std::hypot(column.first + 0.5, column.second + 0.5));
    heights.push_back(z);
  }
  const double cell = quantile(distances, share_within) / radius;
  const double step =
      std::clamp(std::round(2 * std::log2(cell / widest)), static_cast<double>(smallest_step), 0.0);
  BevSpectrumConfig config;
  config.cell = widest * std::exp2(step / 2);
  config.height = config.cell / 10 - quantile(heights, share_below);
  return config;
}

std::vector<float> bev_spectrum(PointsView points, const BevSpectrumConfig& config) {
  validate(config);
  detail::check_points(points, 1, "bev_spectrum");
  std::vector<float> descriptor(static_cast<std::size_t>(directions * rows));
  auto images = draw(points, config);
  for (int layer = 0; layer < layers; ++layer)
    write_polar(log_spectrum(images[static_cast<std::size_t>(layer)]), layer, descriptor.data());
  remove_row_means(descriptor.data());
  normalize_columns(descriptor.data());
  return descriptor;
}

}  // namespace fusionslam
