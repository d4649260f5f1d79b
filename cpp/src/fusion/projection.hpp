// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <string>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "frustum_kernel.hpp"
#include "fusionslam/errors.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

/// A point in an image: column u and row v in pixels, depth in metres along the optical axis.
struct Pixel {
  double u, v, depth;

  /// Of the pixel whose centre is nearest; for points in the image, where the casts round down.
  int column() const { return static_cast<int>(u + 0.5); }
  int row() const { return static_cast<int>(v + 0.5); }
};

inline Pixel project(const float* point, const Projection& p) {
  const double x = point[0], y = point[1], z = point[2];
  const double w = p[8] * x + p[9] * y + p[10] * z + p[11];
  return {(p[0] * x + p[1] * y + p[2] * z + p[3]) / w, (p[4] * x + p[5] * y + p[6] * z + p[7]) / w,
          w};
}

/// In front of the camera, and the nearest pixel centre is one of the image.
inline bool is_visible(const Pixel& pixel, int width, int height) {
  const double u = pixel.u + 0.5, v = pixel.v + 0.5;
  return pixel.depth > 0 && u >= 0 && v >= 0 && u < width && v < height;
}

/// The sides of an image: u >= -1/2, u <= width - 1/2, and the same for v, times the depth; in a
/// scale that float holds.
inline Frustum frustum_of(const Projection& p, int width, int height) {
  const double scale = std::fabs(*std::max_element(
      p.begin(), p.end(), [](double a, double b) { return std::fabs(a) < std::fabs(b); }));
  Frustum frustum{};
  for (std::size_t k = 0; k < 4; ++k) {
    const double u = p[k] / scale, v = p[4 + k] / scale, depth = p[8 + k] / scale;
    frustum.sides[0][k] = static_cast<float>(u + 0.5 * depth);
    frustum.sides[1][k] = static_cast<float>((width - 0.5) * depth - u);
    frustum.sides[2][k] = static_cast<float>(v + 0.5 * depth);
    frustum.sides[3][k] = static_cast<float>((height - 0.5) * depth - v);
  }
  return frustum;
}

/// What an image sees, ready to be looked for in blocks of points.
class ImageRegion {
 public:
  ImageRegion(const Projection& projection, int width, int height)
      : projection_(projection),
        width_(width),
        height_(height),
        frustum_(frustum_of(projection, width, height)) {}

  /// Calls work(i, pixel) for each visible one of the point_block points from `begin` on, in order.
  /// Throws DataError at the first point that is not finite.
  template <class Work>
  void for_each_visible(PointsView points, std::size_t begin, Work&& work) const {
    int list[point_block];
    std::int32_t largest = 0;
    const std::size_t size = std::min(point_block, points.size - begin);
    const int count = list_inside_({points[begin], points.stride, size}, frustum_, list, largest);
    constexpr std::int32_t infinity = 0x7f800000;
    if (largest >= infinity) check_points(points, 0, "the projection");
    for (int k = 0; k < count; ++k) {
      const std::size_t i = begin + static_cast<std::size_t>(list[k]);
      const Pixel pixel = project(points[i], projection_);
      if (is_visible(pixel, width_, height_)) work(i, pixel);
    }
  }

 private:
  Projection projection_;
  int width_, height_;
  Frustum frustum_;
  ListInside* list_inside_ = frustum_kernel(simd_level());
};

/// Calls work(i, pixel) for each point that is visible, in order. Throws DataError at the first
/// point that is not finite.
template <class Work>
void for_each_visible(PointsView points, const Projection& projection, int width, int height,
                      Work&& work) {
  const ImageRegion region(projection, width, height);
  for (std::size_t begin = 0; begin < points.size; begin += point_block) {
    check_interrupt();
    region.for_each_visible(points, begin, work);
  }
}

/// Throws DataError if the matrix is not finite or its left 3x3 part is singular.
inline void check_projection(const Projection& p) {
  for (const double value : p)
    if (!std::isfinite(value)) throw DataError("the projection matrix is not finite");
  const double determinant = p[0] * (p[5] * p[10] - p[6] * p[9]) -
                             p[1] * (p[4] * p[10] - p[6] * p[8]) +
                             p[2] * (p[4] * p[9] - p[5] * p[8]);
  double volume = 1;  // of a box with the rows' lengths
  for (std::size_t row = 0; row < 3; ++row)
    volume *= std::hypot(p[4 * row], p[4 * row + 1], p[4 * row + 2]);
  if (!(std::fabs(determinant) > 1e-12 * volume))
    throw DataError("the projection matrix is singular (missing calibration?)");
}

inline void check_image(ImageView image) {
  if (image.data == nullptr || image.width <= 0 || image.height <= 0)
    throw DataError("the image is empty");
  if (image.channels != 1 && image.channels != 3)
    throw ShapeError("the image has " + std::to_string(image.channels) +
                     " channels, expected 1 (grey) or 3 (RGB)");
  const auto row = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.channels);
  if (image.row_stride < row)
    throw ShapeError("row_stride is " + std::to_string(image.row_stride) +
                     ", a row of the image has " + std::to_string(row) + " bytes");
}

}  // namespace fusionslam::detail
