// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "fusionslam/views/range_image.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <string>
#include <tuple>

#include "../detail/checks.hpp"

namespace fusionslam {
namespace {

constexpr double degrees = 180 / std::numbers::pi;
// Points this much farther than the nearest of their cell, and this share of its range, are of
// another surface.
constexpr double surface_depth = 0.1;
constexpr double surface_share = 0.05;

struct Sample {
  std::int16_t row, column;
  float range;
  std::uint32_t point;
};

/// The cell and range of each point that lies in reach, nearest first in each cell.
std::vector<Sample> samples_of(PointsView points, const RangeImageConfig& config) {
  std::vector<Sample> samples;
  samples.reserve(points.size);
  for (std::size_t i = 0; i < points.size; ++i) {
    const double x = points[i][0] - config.sensor_x, y = points[i][1] - config.sensor_y;
    const double z = points[i][2] - config.sensor_z, level = std::hypot(x, y);
    const double range = std::hypot(level, z);
    if (range > config.longest_range || range < RangeImage::range_step) continue;
    const double column = std::atan2(y, x) * degrees / config.azimuth_step;
    const double row = std::atan2(z, level) * degrees / config.elevation_step;
    samples.push_back({static_cast<std::int16_t>(std::lround(row)),
                       static_cast<std::int16_t>(std::lround(column)), static_cast<float>(range),
                       static_cast<std::uint32_t>(i)});
  }
  std::sort(samples.begin(), samples.end(), [](const Sample& a, const Sample& b) {
    return std::tie(a.row, a.column, a.range, a.point) <
           std::tie(b.row, b.column, b.range, b.point);
  });
  return samples;
}

/// The multiple of color_step about which the value lies.
std::uint8_t in_steps(double value) {
  const int steps = static_cast<int>(value) / RangeImage::color_step;
  return static_cast<std::uint8_t>(steps * RangeImage::color_step);
}

/// Mean range and colour of the nearest surface among the samples of one cell.
RangeImage::Cell cell_of(const Sample* first, const Sample* last, ColorsView colors) {
  const double limit = first->range * (1 + surface_share) + surface_depth;
  double range = 0;
  std::array<double, 3> color{};
  const Sample* sample = first;
  for (; sample != last && sample->range <= limit; ++sample) {
    range += sample->range;
    for (std::size_t i = 0; i < 3; ++i) color[i] += colors.at(sample->point, static_cast<int>(i));
  }
  const auto count = static_cast<double>(sample - first);
  RangeImage::Cell cell{first->column, first->row, 0, {}};
  cell.range = static_cast<std::uint16_t>(std::lround(range / count / RangeImage::range_step));
  for (std::size_t i = 0; i < 3; ++i) cell.color[i] = in_steps(color[i] / count);
  return cell;
}

bool is_cell(const RangeImage& image, std::size_t i) {
  const RangeImage::Cell& cell = image.cells[i];
  const auto place = [](const RangeImage::Cell& c) { return std::tie(c.row, c.column); };
  return (i == 0 || place(image.cells[i - 1]) < place(cell)) &&
         std::abs(cell.column) * image.azimuth_step <= 360 &&
         std::abs(cell.row) * image.elevation_step <= 180 &&
         std::all_of(cell.color.begin(), cell.color.end(),
                     [](int value) { return value % RangeImage::color_step == 0; });
}

}  // namespace

void check_range_image(const RangeImage& image) {
  if (image.cells.empty()) return;
  if (!image.has_possible_steps())
    throw DataError("range image: steps of " + std::to_string(image.azimuth_step) + " and " +
                    std::to_string(image.elevation_step) + " deg, expected 0.1 to 30");
  for (const float value : image.sensor)
    if (!(std::fabs(value) <= 1e3f))
      throw DataError("range image: the sensor is " + std::to_string(value) +
                      " m from the origin, expected at most 1000");
  for (std::size_t i = 0; i < image.cells.size(); ++i)
    if (!is_cell(image, i))
      throw DataError("range image, cell " + std::to_string(i) +
                      ": out of order, out of range, or of a colour between the steps");
}

RangeImage range_image(PointsView points, ColorsView colors, const RangeImageConfig& config) {
  validate(config);
  detail::check_colors(points, colors);
  detail::check_points(points, 0, "a range image");
  const std::vector<Sample> samples = samples_of(points, config);
  RangeImage image;
  if (samples.empty()) return image;
  image.azimuth_step = static_cast<float>(config.azimuth_step);
  image.elevation_step = static_cast<float>(config.elevation_step);
  image.sensor = {static_cast<float>(config.sensor_x), static_cast<float>(config.sensor_y),
                  static_cast<float>(config.sensor_z)};
  const Sample* const end = samples.data() + samples.size();
  for (const Sample* first = samples.data(); first != end;) {
    const Sample* last = first;
    while (last != end && last->row == first->row && last->column == first->column) ++last;
    image.cells.push_back(cell_of(first, last, colors));
    first = last;
  }
  return image;
}

}  // namespace fusionslam
