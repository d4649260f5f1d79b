// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// With opencv.hpp and stereo.cpp's includes the only place that names PCL's headers.
#pragma once

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

inline pcl::PointCloud<pcl::PointXYZ>::Ptr pcl_cloud(PointsView points) {
  auto cloud = std::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  cloud->reserve(points.size);
  for (std::size_t i = 0; i < points.size; ++i)
    cloud->emplace_back(points[i][0], points[i][1], points[i][2]);
  return cloud;
}

}  // namespace fusionslam::detail
