// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
/// Views of PCL clouds without copying. Header-only: include it where PCL is there anyway.
#pragma once

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Points of any PCL cloud whose points hold x, y, z; valid as long as the cloud is unchanged.
template <class Point>
PointsView points_view(const pcl::PointCloud<Point>& cloud) {
  static_assert(sizeof(Point) % sizeof(float) == 0);
  if (cloud.empty()) return {};
  return {&cloud.points[0].x, cloud.size(), sizeof(Point) / sizeof(float)};
}

/// Colours of a PCL cloud whose points hold r, g, b (stored as b, g, r).
template <class Point>
ColorsView colors_view(const pcl::PointCloud<Point>& cloud) {
  if (cloud.empty()) return {};
  const Point& first = cloud.points[0];
  return {&first.r, cloud.size(), sizeof(Point), &first.g - &first.r};
}

}  // namespace fusionslam
