// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "fusionslam/views/scene.hpp"

namespace fusionslam::detail {

/// Hull and extents of a point set.
struct Shape {
  Hull hull;
  std::array<double, 3> extents{};  ///< m, along the principal axes, longest first
  std::array<double, 3> box_min{};
  std::array<double, 3> box_max{};
};

/// The shape of at least one point, all of them finite.
Shape shape_of(PointsView points);

}  // namespace fusionslam::detail
