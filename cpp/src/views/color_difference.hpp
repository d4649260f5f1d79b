// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>

#include "fusionslam/views/similarity.hpp"

namespace fusionslam::detail {

/// Coordinates of a colour in the space in which that kind of difference is computed.
std::array<double, 3> color_coordinates(const std::array<double, 3>& rgb, ColorDifference kind);

/// The difference of two such colours; for all kinds but ciede2000 their Euclidean distance.
double coordinate_difference(const std::array<double, 3>& a, const std::array<double, 3>& b,
                             ColorDifference kind);

inline double length_of_difference(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
  return std::sqrt(x * x + y * y + z * z);
}

}  // namespace fusionslam::detail
