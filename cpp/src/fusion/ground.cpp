// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <pcl/segmentation/sac_segmentation.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "../detail/checks.hpp"
#include "../detail/pcl.hpp"
#include "fusionslam/fusion.hpp"

namespace fusionslam {
namespace {

struct Axis {
  std::size_t coordinate;
  double sign;
};

Axis axis_of(UpAxis up) {
  const auto number = static_cast<std::size_t>(up);
  return {number % 3, number < 3 ? 1.0 : -1.0};
}

Eigen::Vector3f direction(UpAxis up) {
  const Axis axis = axis_of(up);
  Eigen::Vector3f result = Eigen::Vector3f::Zero();
  result[static_cast<Eigen::Index>(axis.coordinate)] = static_cast<float>(axis.sign);
  return result;
}

pcl::ModelCoefficients fit(const pcl::PointCloud<pcl::PointXYZ>::Ptr& cloud, UpAxis up,
                           const GroundPlaneConfig& config) {
  pcl::SACSegmentation<pcl::PointXYZ> segmentation;
  segmentation.setModelType(pcl::SACMODEL_PERPENDICULAR_PLANE);
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setAxis(direction(up));
  // PCL takes 0 for no limit at all, and its float angles are good to some 1e-4.
  segmentation.setEpsAngle(std::max(config.max_tilt * std::numbers::pi / 180, 1e-3));
  segmentation.setDistanceThreshold(config.distance);
  segmentation.setMaxIterations(config.iterations);
  segmentation.setInputCloud(cloud);
  pcl::PointIndices inliers;
  pcl::ModelCoefficients coefficients;
  const detail::QuietPcl quiet;
  segmentation.segment(inliers, coefficients);
  return coefficients;
}

double signed_distance(const std::array<double, 4>& plane, const float* p) {
  return plane[0] * p[0] + plane[1] * p[1] + plane[2] * p[2] + plane[3];
}

}  // namespace

std::vector<std::int64_t> above_height(PointsView points, double height, UpAxis up) {
  if (!std::isfinite(height)) throw ConfigError("ground height is not finite");
  detail::check_points(points, 0, "ground removal");
  const Axis axis = axis_of(up);
  std::vector<std::int64_t> kept;
  for (std::size_t i = 0; i < points.size; ++i)
    if (axis.sign * points[i][axis.coordinate] > height)
      kept.push_back(static_cast<std::int64_t>(i));
  return kept;
}

GroundPlane remove_ground_plane(PointsView points, UpAxis up, const GroundPlaneConfig& config) {
  validate(config);
  detail::check_points(points, 3, "the ground plane");
  const auto fitted = fit(detail::pcl_cloud(points), up, config);
  GroundPlane ground;
  if (fitted.values.size() == 4) {
    const Axis axis = axis_of(up);
    const double sign = axis.sign * fitted.values[axis.coordinate] < 0 ? -1 : 1;
    for (std::size_t i = 0; i < 4; ++i) ground.coefficients[i] = sign * fitted.values[i];
  }
  const bool found = fitted.values.size() == 4;
  for (std::size_t i = 0; i < points.size; ++i)
    if (!found || std::fabs(signed_distance(ground.coefficients, points[i])) > config.distance)
      ground.kept.push_back(static_cast<std::int64_t>(i));
  return ground;
}

}  // namespace fusionslam
