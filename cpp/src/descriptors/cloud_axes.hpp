// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "fusionslam/descriptors.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

/// A cloud's own frame.
struct OwnFrame {
  Eigen::Vector3d mean;
  Eigen::Matrix3d axes;  ///< as rows
  double mean_square;    ///< distance from the mean
};

/// Mean and PCA of a cloud, the longest axis first, with the signs of PCL (`pcl`) or MATLAB (all
/// other rules; those of `mirror_pairs` do not matter). Throws DataError if a point is not finite,
/// or if all points are equal or on one line.
OwnFrame principal_axes(PointsView points, AxisSigns signs);

/// Mean of a cloud, and axes of which z stays and x points towards the densest azimuth about the
/// mean: the maximum of the points' density over azimuth, each weighted by its cubed distance from
/// the vertical through the mean, smoothed by a Gaussian of 0.5 rad. Throws DataError if a point
/// is not finite, or if all points are on one vertical line.
OwnFrame upright_axes(PointsView points);

}  // namespace fusionslam::detail
