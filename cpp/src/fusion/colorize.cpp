// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <utility>

#include "fusionslam/fusion.hpp"
#include "pixel_color.hpp"
#include "projection.hpp"

namespace fusionslam {
namespace {

/// A cloud that grows without being filled with zeros first for each point.
class Collector {
 public:
  explicit Collector(std::size_t expected) { resize(expected); }

  void add(const float* point, const detail::Color& color, std::size_t index) {
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
  detail::for_each_visible(points, projection, image.width, image.height,
                           [&](std::size_t i, const detail::Pixel& pixel) {
                             cloud.add(points[i], detail::read_color(image, pixel, interpolation),
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
