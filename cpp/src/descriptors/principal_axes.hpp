// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "fusionslam/descriptors.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

/// The cloud's own frame: its mean, and its principal axes as rows, longest first.
struct PrincipalAxes {
  Eigen::Vector3d mean;
  Eigen::Matrix3d axes;
  double mean_square;  ///< distance from the mean
};

/// Mean and PCA of a cloud with the signs of PCL (`pcl`) or MATLAB (all other rules; those of
/// `mirror_pairs` do not matter). Throws DataError if a point is not finite, or if
/// all points are equal or on one line.
PrincipalAxes principal_axes(PointsView points, AxisSigns signs);

}  // namespace fusionslam::detail
