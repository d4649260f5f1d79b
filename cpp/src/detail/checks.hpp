// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>
#include <span>
#include <string>

#include "fusionslam/errors.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

inline bool is_finite(const float* point) {
  return std::isfinite(point[0]) && std::isfinite(point[1]) && std::isfinite(point[2]);
}

/// "1 point", "2 points".
inline std::string count_text(std::size_t count, const std::string& noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

/// Throws DataError unless there are `minimum` points.
inline void check_size(PointsView points, std::size_t minimum, const char* what) {
  if (points.size < minimum)
    throw DataError("the cloud has " + count_text(points.size, "point") + ", " + what +
                    " needs at least " + std::to_string(minimum));
}

/// Throws DataError unless there are `minimum` points, all of them finite.
inline void check_points(PointsView points, std::size_t minimum, const char* what) {
  check_size(points, minimum, what);
  for (std::size_t i = 0; i < points.size; ++i)
    if (!is_finite(points[i]))
      throw DataError("point " + std::to_string(i) +
                      " is not finite; drop such points first (drop_invalid)");
}

inline void check_colors(PointsView points, ColorsView colors) {
  if (points.size != colors.size)
    throw ShapeError("colors has " + count_text(colors.size, "row") + ", points has " +
                     std::to_string(points.size));
}

/// Throws ShapeError unless there is one intensity a point, DataError unless all are finite and
/// >= 0.
inline void check_intensities(PointsView points, std::span<const float> intensities) {
  if (points.size != intensities.size())
    throw ShapeError("intensities has " + count_text(intensities.size(), "value") +
                     ", points has " + std::to_string(points.size));
  for (std::size_t i = 0; i < intensities.size(); ++i)
    if (!(intensities[i] >= 0 && std::isfinite(intensities[i])))
      throw DataError("intensity " + std::to_string(i) + " is " + std::to_string(intensities[i]) +
                      ", expected a finite one >= 0");
}

}  // namespace fusionslam::detail
