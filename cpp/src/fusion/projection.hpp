// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <string>

#include "fusionslam/errors.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

/// A point in an image: column u and row v in pixels, depth in metres along the optical axis.
struct Pixel {
  double u, v, depth;
};

inline Pixel project(const float* point, const Projection& p) {
  const double x = point[0], y = point[1], z = point[2];
  const double w = p[8] * x + p[9] * y + p[10] * z + p[11];
  return {(p[0] * x + p[1] * y + p[2] * z + p[3]) / w, (p[4] * x + p[5] * y + p[6] * z + p[7]) / w,
          w};
}

/// The pixel centre nearest to a projected point; false if that is outside or behind the camera.
inline bool nearest_pixel(const Pixel& pixel, int width, int height, int& column, int& row) {
  if (!(pixel.depth > 0)) return false;
  const double u = std::floor(pixel.u + 0.5);
  const double v = std::floor(pixel.v + 0.5);
  if (!(u >= 0 && v >= 0 && u < width && v < height)) return false;
  column = static_cast<int>(u);
  row = static_cast<int>(v);
  return true;
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
