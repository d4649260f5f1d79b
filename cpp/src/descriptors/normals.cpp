// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <pcl/features/normal_3d_omp.h>
#include <pcl/search/kdtree.h>

#include <cmath>

#include "../detail/checks.hpp"
#include "../detail/parallel.hpp"
#include "../detail/pcl.hpp"
#include "fusionslam/descriptors.hpp"

namespace fusionslam {
namespace {

pcl::PointCloud<pcl::Normal> pcl_normals(PointsView points, double radius, int threads) {
  const auto cloud = detail::pcl_cloud(points);
  pcl::NormalEstimationOMP<pcl::PointXYZ, pcl::Normal> estimation(
      static_cast<unsigned>(detail::thread_count(threads)));
  estimation.setInputCloud(cloud);
  estimation.setSearchMethod(std::make_shared<pcl::search::KdTree<pcl::PointXYZ>>());
  estimation.setRadiusSearch(radius);
  pcl::PointCloud<pcl::Normal> normals;
  estimation.compute(normals);
  return normals;
}

}  // namespace

double cloud_resolution(PointsView points) {
  detail::check_points(points, 2, "the resolution");
  const auto cloud = detail::pcl_cloud(points);
  pcl::search::KdTree<pcl::PointXYZ> tree;
  tree.setInputCloud(cloud);
  double sum = 0;
  pcl::Indices neighbors(2);
  std::vector<float> squared(2);
  for (const auto& point : *cloud) {
    tree.nearestKSearch(point, 2, neighbors, squared);
    sum += std::sqrt(static_cast<double>(squared[1]));
  }
  return sum / static_cast<double>(points.size);
}

Normals estimate_normals(PointsView points, double radius, int threads) {
  if (!(radius > 0))
    throw ConfigError("normal_radius is " + std::to_string(radius) + ", expected > 0");
  detail::check_points(points, 3, "normal estimation");
  const auto estimated = pcl_normals(points, radius, threads);
  Normals result;
  for (std::size_t i = 0; i < estimated.size(); ++i) {
    const auto& normal = estimated[i];
    if (!std::isfinite(normal.normal_x)) continue;
    result.normals.insert(result.normals.end(),
                          {normal.normal_x, normal.normal_y, normal.normal_z});
    result.curvatures.push_back(normal.curvature);
    result.indices.push_back(static_cast<std::int64_t>(i));
  }
  return result;
}

}  // namespace fusionslam
