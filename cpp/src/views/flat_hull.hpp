// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

namespace fusionslam::detail {

/// Area and centroid of the convex hull of points in a plane; of points on a line, the middle.
struct FlatHull {
  double area = 0;
  Eigen::Vector2d centroid;
};

FlatHull flat_hull(std::vector<Eigen::Vector2d> points);

}  // namespace fusionslam::detail
