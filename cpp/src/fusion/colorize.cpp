// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <utility>

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

/// A cloud that grows without being filled with zeros first for each point.
class Collector {
 public:
  explicit Collector(std::size_t expected) { resize(expected); }

  void add(const float* point, const Color& color, std::size_t index) {
    if (size_ == cloud_.indices.size()) resize(2 * size_ + 1024);
    std::copy_n(point, 3, cloud_.points.data() + 3 * size_);
    std::copy_n(color.data(), 3, cloud_.colors.data() + 3 * size_);
    cloud_.indices[size_++] = static_cast<std::int64_t>(index);
  }

  ColoredCloud take() {
    resize(size_);
    return std::move(cloud_);
  }

 private:
  void resize(std::size_t size) {
    cloud_.points.resize(3 * size);
    cloud_.colors.resize(3 * size);
    cloud_.indices.resize(size);
  }

  ColoredCloud cloud_;
  std::size_t size_ = 0;
};

}  // namespace

ColoredCloud colorize(PointsView points, ImageView image, const Projection& projection,
                      Interpolation interpolation) {
  detail::check_projection(projection);
  detail::check_image(image);
  Collector cloud(points.size / 5);  // of a full circle a camera sees about that much
  const bool nearest = interpolation == Interpolation::nearest;
  detail::for_each_visible(points, projection, image.width, image.height,
                           [&](std::size_t i, const detail::Pixel& pixel) {
                             cloud.add(points[i],
                                       nearest ? color_at(image, pixel.row(), pixel.column())
                                               : bilinear_color(image, pixel.u, pixel.v),
                                       i);
                           });
  return cloud.take();
}

std::vector<float> depth_image(PointsView points, int width, int height,
                               const Projection& projection) {
  detail::check_projection(projection);
  constexpr int most = 1 << 15;
  if (width <= 0 || height <= 0 || width > most || height > most)
    throw DataError("an image of " + std::to_string(width) + "x" + std::to_string(height) +
                    ", expected 1 to " + std::to_string(most) + " pixels a side");
  std::vector<float> depth(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  detail::for_each_visible(
      points, projection, width, height, [&](std::size_t, const detail::Pixel& pixel) {
        float& nearest =
            depth[static_cast<std::size_t>(pixel.row()) * static_cast<std::size_t>(width) +
                  static_cast<std::size_t>(pixel.column())];
        const auto here = static_cast<float>(pixel.depth);
        if (nearest == 0 || here < nearest) nearest = here;
      });
  return depth;
}

}  // namespace fusionslam
