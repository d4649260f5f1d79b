// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// SHOT and CSHOT as global descriptors: one keypoint, the centroid, supported by the whole cloud.
#include <pcl/features/shot.h>
#include <pcl/search/kdtree.h>

#include <algorithm>
#include <cmath>

#include "../detail/checks.hpp"
#include "../detail/pcl.hpp"
#include "fusionslam/descriptors.hpp"
#include "principal_axes.hpp"

namespace fusionslam {
namespace {

using Point = pcl::PointXYZRGB;
using PointCloud = pcl::PointCloud<Point>;
using NormalCloud = pcl::PointCloud<pcl::Normal>;

/// The points that have a normal, with colours (black where there are none) and normals.
struct Surface {
  PointCloud::Ptr points = std::make_shared<PointCloud>();
  NormalCloud::Ptr normals = std::make_shared<NormalCloud>();
};

Surface surface(PointsView points, ColorsView colors, const Normals& normals) {
  Surface result;
  for (std::size_t i = 0; i < normals.indices.size(); ++i) {
    const auto source = static_cast<std::size_t>(normals.indices[i]);
    Point point(points[source][0], points[source][1], points[source][2]);
    if (colors.data) {
      point.r = colors.at(source, 0);
      point.g = colors.at(source, 1);
      point.b = colors.at(source, 2);
    }
    result.points->push_back(point);
    const float* n = normals.normals.data() + 3 * i;
    result.normals->push_back(pcl::Normal(n[0], n[1], n[2], normals.curvatures[i]));
  }
  return result;
}

/// Mean position and colour of the cloud.
PointCloud::Ptr centroid(const PointCloud& cloud) {
  double sum[6] = {0, 0, 0, 0, 0, 0};
  for (const auto& p : cloud) {
    const double values[6] = {p.x, p.y, p.z, double(p.r), double(p.g), double(p.b)};
    for (int i = 0; i < 6; ++i) sum[i] += values[i];
  }
  for (double& value : sum) value /= static_cast<double>(cloud.size());
  Point mean(static_cast<float>(sum[0]), static_cast<float>(sum[1]), static_cast<float>(sum[2]));
  mean.r = static_cast<std::uint8_t>(sum[3]);
  mean.g = static_cast<std::uint8_t>(sum[4]);
  mean.b = static_cast<std::uint8_t>(sum[5]);
  auto keypoints = std::make_shared<PointCloud>();
  keypoints->push_back(mean);
  return keypoints;
}

double largest_distance(const PointCloud& cloud, const Point& from) {
  float largest = 0;
  for (const auto& p : cloud)
    largest = std::max(largest, (p.getVector3fMap() - from.getVector3fMap()).squaredNorm());
  return std::sqrt(static_cast<double>(largest));
}

template <class Estimation, class Descriptor>
std::vector<float> describe(const Surface& surface, const char* name) {
  const auto keypoints = centroid(*surface.points);
  const double radius = largest_distance(*surface.points, keypoints->front());
  if (!(radius > 0))
    throw DataError(std::string("all points are equal, ") + name + " is undefined");
  Estimation estimation;
  estimation.setInputCloud(keypoints);
  estimation.setSearchSurface(surface.points);
  estimation.setInputNormals(surface.normals);
  estimation.setSearchMethod(std::make_shared<pcl::search::KdTree<Point>>());
  estimation.setRadiusSearch(radius);
  pcl::PointCloud<Descriptor> descriptors;
  const detail::QuietPcl quiet;
  estimation.compute(descriptors);
  const auto& values = descriptors.front().descriptor;
  std::vector<float> result(std::begin(values), std::end(values));
  if (!std::all_of(result.begin(), result.end(), [](float v) { return std::isfinite(v); }))
    throw DataError(std::string(name) + " has no local reference frame on this cloud");
  return result;
}

Surface surface_with_normals(PointsView points, ColorsView colors,
                             std::optional<double> normal_radius, int threads, const char* name) {
  detail::check_points(points, 5, name);
  // Points on one line have normals by rounding only.
  detail::principal_axes(points, AxisSigns::largest_entry);
  const double radius = normal_radius ? *normal_radius : 5 * cloud_resolution(points);
  if (!normal_radius && !(radius > 0))
    throw DataError("each point of the cloud lies on another one: it has no resolution");
  const Normals normals = estimate_normals(points, radius, threads);
  if (normals.indices.size() < 5)
    throw DataError(std::string(name) + " needs at least 5 points with a normal, " +
                    std::to_string(normals.indices.size()) + " have 3 neighbours within " +
                    std::to_string(radius) + " m");
  return surface(points, colors, normals);
}

}  // namespace

std::vector<float> shot(PointsView points, std::optional<double> normal_radius, int threads) {
  return describe<pcl::SHOTEstimation<Point, pcl::Normal, pcl::SHOT352>, pcl::SHOT352>(
      surface_with_normals(points, {}, normal_radius, threads, "SHOT"), "SHOT");
}

std::vector<float> cshot(PointsView points, ColorsView colors, std::optional<double> normal_radius,
                         int threads) {
  detail::check_colors(points, colors);
  return describe<pcl::SHOTColorEstimation<Point, pcl::Normal, pcl::SHOT1344>, pcl::SHOT1344>(
      surface_with_normals(points, colors, normal_radius, threads, "CSHOT"), "CSHOT");
}

}  // namespace fusionslam
