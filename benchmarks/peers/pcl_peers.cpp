// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "pcl_peers.hpp"

#include <pcl/features/normal_3d_omp.h>
#include <pcl/features/shot.h>
#include <pcl/pcl_config.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>

#include <algorithm>
#include <cmath>

namespace peers {
namespace {

using Point = pcl::PointXYZRGB;
using Cloud = pcl::PointCloud<Point>;
using Normals = pcl::PointCloud<pcl::Normal>;
using Tree = pcl::search::KdTree<Point>;

}  // namespace

struct PclCloud::Data {
  Cloud::Ptr points = std::make_shared<Cloud>();
};

struct PclSurface::Data {
  Cloud::Ptr points = std::make_shared<Cloud>();
  Normals::Ptr normals = std::make_shared<Normals>();
  std::vector<std::int64_t> indices;
};

namespace {

Normals estimate(const Cloud::ConstPtr& points, double radius, int threads) {
  Normals normals;
  const auto run = [&](auto&& estimation) {
    estimation.setInputCloud(points);
    estimation.setSearchMethod(std::make_shared<Tree>());
    estimation.setRadiusSearch(radius);
    estimation.compute(normals);
  };
  if (threads > 1)
    run(pcl::NormalEstimationOMP<Point, pcl::Normal>(static_cast<unsigned>(threads)));
  else
    run(pcl::NormalEstimation<Point, pcl::Normal>());
  return normals;
}

/// The mean point with the mean colour, in whole bytes.
Cloud::Ptr keypoint(const Cloud& points) {
  double sum[6] = {};
  for (const Point& p : points) {
    const double values[6] = {p.x, p.y, p.z, double(p.r), double(p.g), double(p.b)};
    for (int i = 0; i < 6; ++i) sum[i] += values[i];
  }
  for (double& value : sum) value /= static_cast<double>(points.size());
  auto cloud = std::make_shared<Cloud>();
  cloud->emplace_back(static_cast<float>(sum[0]), static_cast<float>(sum[1]),
                      static_cast<float>(sum[2]), static_cast<std::uint8_t>(sum[3]),
                      static_cast<std::uint8_t>(sum[4]), static_cast<std::uint8_t>(sum[5]));
  return cloud;
}

double farthest(const Cloud& points, const Point& from) {
  float largest = 0;
  for (const Point& p : points)
    largest = std::max(largest, (p.getVector3fMap() - from.getVector3fMap()).squaredNorm());
  return std::sqrt(static_cast<double>(largest));
}

template <class Estimation, class Descriptor>
std::vector<float> describe(const PclSurface::Data& surface) {
  const auto keypoints = keypoint(*surface.points);
  Estimation estimation;
  estimation.setInputCloud(keypoints);
  estimation.setSearchSurface(surface.points);
  estimation.setInputNormals(surface.normals);
  estimation.setSearchMethod(std::make_shared<Tree>());
  estimation.setRadiusSearch(farthest(*surface.points, keypoints->front()));
  pcl::PointCloud<Descriptor> descriptors;
  estimation.compute(descriptors);
  const auto& values = descriptors.front().descriptor;
  return {std::begin(values), std::end(values)};
}

}  // namespace

PclCloud::PclCloud(const float* xyz, const std::uint8_t* rgb, std::size_t size) {
  auto data = std::make_shared<Data>();
  data->points->reserve(size);
  for (std::size_t i = 0; i < size; ++i, xyz += 3) {
    const std::uint8_t* color = rgb ? rgb + 3 * i : nullptr;
    data->points->emplace_back(xyz[0], xyz[1], xyz[2], color ? color[0] : std::uint8_t{0},
                               color ? color[1] : std::uint8_t{0},
                               color ? color[2] : std::uint8_t{0});
  }
  data_ = std::move(data);
}

PclSurface::PclSurface(const PclCloud& cloud, double radius, int threads) {
  const Cloud::Ptr& points = cloud.data().points;
  const Normals normals = estimate(points, radius, threads);
  auto data = std::make_shared<Data>();
  data->points->reserve(points->size());
  data->normals->reserve(points->size());
  data->indices.reserve(points->size());
  for (std::size_t i = 0; i < normals.size(); ++i) {
    if (!std::isfinite(normals[i].normal_x)) continue;
    data->points->push_back((*points)[i]);
    data->normals->push_back(normals[i]);
    data->indices.push_back(static_cast<std::int64_t>(i));
  }
  data_ = std::move(data);
}

std::vector<float> PclSurface::normals() const {
  std::vector<float> values;
  for (const pcl::Normal& n : *data_->normals)
    values.insert(values.end(), {n.normal_x, n.normal_y, n.normal_z});
  return values;
}

std::vector<std::int64_t> PclSurface::indices() const { return data_->indices; }

std::vector<float> pcl_shot(const PclSurface& surface) {
  return describe<pcl::SHOTEstimation<Point, pcl::Normal, pcl::SHOT352>, pcl::SHOT352>(
      surface.data());
}

std::vector<float> pcl_cshot(const PclSurface& surface) {
  return describe<pcl::SHOTColorEstimation<Point, pcl::Normal, pcl::SHOT1344>, pcl::SHOT1344>(
      surface.data());
}

std::size_t pcl_colorize(const PclCloud& cloud, const std::uint8_t* image, int width, int height,
                         const std::array<double, 12>& projection, ColoredPoints* result) {
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> matrix(projection.data());
  Cloud colored;
  for (const Point& point : *cloud.data().points) {
    const Eigen::Vector3d pixel = matrix * point.getVector4fMap().cast<double>();
    if (!(pixel.z() > 0)) continue;
    const double column = std::floor(pixel.x() / pixel.z() + 0.5);
    const double row = std::floor(pixel.y() / pixel.z() + 0.5);
    if (column < 0 || row < 0 || column >= width || row >= height) continue;
    const std::uint8_t* color =
        image + 3 * (static_cast<std::size_t>(row) * static_cast<std::size_t>(width) +
                     static_cast<std::size_t>(column));
    colored.emplace_back(point.x, point.y, point.z, color[0], color[1], color[2]);
  }
  if (result)
    for (const Point& p : colored) {
      result->xyz.insert(result->xyz.end(), {p.x, p.y, p.z});
      result->rgb.insert(result->rgb.end(), {p.r, p.g, p.b});
    }
  return colored.size();
}

const char* pcl_version() { return PCL_VERSION_PRETTY; }

}  // namespace peers
