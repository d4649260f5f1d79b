// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>

#include "../detail/checks.hpp"
#include "fusionslam/fusion.hpp"
#include "projection.hpp"

namespace fusionslam {
namespace {

using Color = std::array<std::uint8_t, 3>;

Color color_at(ImageView image, int row, int column) {
  const std::uint8_t* pixel = image.pixel(row, column);
  return image.channels == 3 ? Color{pixel[0], pixel[1], pixel[2]}
                             : Color{pixel[0], pixel[0], pixel[0]};
}

/// Weighted mean of the four pixel centres around (u, v); outside the outermost centres the
/// nearest.
Color bilinear_color(ImageView image, double u, double v) {
  u = std::clamp(u, 0.0, image.width - 1.0);
  v = std::clamp(v, 0.0, image.height - 1.0);
  const int column = std::min(static_cast<int>(u), std::max(image.width - 2, 0));
  const int row = std::min(static_cast<int>(v), std::max(image.height - 2, 0));
  const int next_column = std::min(column + 1, image.width - 1);
  const int next_row = std::min(row + 1, image.height - 1);
  const double right = u - column;
  const double down = v - row;
  const Color corners[4] = {color_at(image, row, column), color_at(image, row, next_column),
                            color_at(image, next_row, column),
                            color_at(image, next_row, next_column)};
  const double weights[4] = {(1 - right) * (1 - down), right * (1 - down), (1 - right) * down,
                             right * down};
  Color result{};
  for (std::size_t channel = 0; channel < 3; ++channel) {
    double sum = 0.5;
    for (std::size_t i = 0; i < 4; ++i) sum += weights[i] * corners[i][channel];
    result[channel] = static_cast<std::uint8_t>(sum);
  }
  return result;
}

void append(ColoredCloud& cloud, const float* point, const Color& color, std::size_t index) {
  cloud.points.insert(cloud.points.end(), point, point + 3);
  cloud.colors.insert(cloud.colors.end(), color.begin(), color.end());
  cloud.indices.push_back(static_cast<std::int64_t>(index));
}

}  // namespace

ColoredCloud colorize(PointsView points, ImageView image, const Projection& projection,
                      Interpolation interpolation) {
  detail::check_projection(projection);
  detail::check_image(image);
  detail::check_points(points, 0, "colorize");
  ColoredCloud cloud;
  for (std::size_t i = 0; i < points.size; ++i) {
    const auto pixel = detail::project(points[i], projection);
    int column = 0;
    int row = 0;
    if (!detail::nearest_pixel(pixel, image.width, image.height, column, row)) continue;
    append(cloud, points[i],
           interpolation == Interpolation::nearest ? color_at(image, row, column)
                                                   : bilinear_color(image, pixel.u, pixel.v),
           i);
  }
  return cloud;
}

std::vector<float> depth_image(PointsView points, int width, int height,
                               const Projection& projection) {
  detail::check_projection(projection);
  constexpr int most = 1 << 15;
  if (width <= 0 || height <= 0 || width > most || height > most)
    throw DataError("an image of " + std::to_string(width) + "x" + std::to_string(height) +
                    ", expected 1 to " + std::to_string(most) + " pixels a side");
  detail::check_points(points, 0, "depth_image");
  std::vector<float> depth(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (std::size_t i = 0; i < points.size; ++i) {
    const auto pixel = detail::project(points[i], projection);
    int column = 0;
    int row = 0;
    if (!detail::nearest_pixel(pixel, width, height, column, row)) continue;
    float& nearest = depth[static_cast<std::size_t>(row) * static_cast<std::size_t>(width) +
                           static_cast<std::size_t>(column)];
    const auto here = static_cast<float>(pixel.depth);
    if (nearest == 0 || here < nearest) nearest = here;
  }
  return depth;
}

}  // namespace fusionslam
