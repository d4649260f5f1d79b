// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Normals, SHOT and CSHOT against PCL's own classes.
#include <doctest/doctest.h>
#include <pcl/common/centroid.h>
#include <pcl/common/distances.h>
#include <pcl/features/normal_3d.h>
#include <pcl/features/shot.h>
#include <pcl/search/kdtree.h>

#include <bit>
#include <cmath>
#include <random>

#include "clouds.hpp"
#include "descriptors/shot_reference_frame.hpp"
#include "fusionslam/descriptors.hpp"
#include "levels.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using testing::Cloud;
using Point = pcl::PointXYZRGB;
using NormalCloud = pcl::PointCloud<pcl::Normal>;

NormalCloud pcl_normals(const Cloud& cloud, double radius) {
  auto points = std::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  for (std::size_t i = 0; i < cloud.points.size(); i += 3)
    points->emplace_back(cloud.points[i], cloud.points[i + 1], cloud.points[i + 2]);
  pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
  estimation.setInputCloud(points);
  estimation.setSearchMethod(std::make_shared<pcl::search::KdTree<pcl::PointXYZ>>());
  estimation.setRadiusSearch(radius);
  NormalCloud normals;
  estimation.compute(normals);
  return normals;
}

template <class Estimation, class Descriptor>
std::vector<float> pcl_shot(const Cloud& cloud, double normal_radius, bool colored) {
  const NormalCloud all = pcl_normals(cloud, normal_radius);
  auto points = std::make_shared<pcl::PointCloud<Point>>();
  auto normals = std::make_shared<NormalCloud>();
  std::size_t sums[3] = {};
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!std::isfinite(all[i].normal_x)) continue;
    const float* p = cloud.points.data() + 3 * i;
    const std::uint8_t* c = cloud.colors.data() + 3 * i;
    points->push_back(colored ? Point(p[0], p[1], p[2], c[0], c[1], c[2])
                              : Point(p[0], p[1], p[2]));
    normals->push_back(all[i]);
    for (std::size_t k = 0; k < 3; ++k) sums[k] += c[k];
  }
  Eigen::Vector4f centroid = Eigen::Vector4f::Zero();
  pcl::compute3DCentroid(*points, centroid);
  Point mean(centroid[0], centroid[1], centroid[2]);
  if (colored) {
    mean.r = static_cast<std::uint8_t>(sums[0] / points->size());
    mean.g = static_cast<std::uint8_t>(sums[1] / points->size());
    mean.b = static_cast<std::uint8_t>(sums[2] / points->size());
  }
  float radius = 0;
  for (const Point& p : *points) radius = std::max(radius, pcl::euclideanDistance(p, mean));
  auto keypoint = std::make_shared<pcl::PointCloud<Point>>();
  keypoint->push_back(mean);
  Estimation estimation;
  estimation.setInputCloud(keypoint);
  estimation.setSearchSurface(points);
  estimation.setInputNormals(normals);
  estimation.setSearchMethod(std::make_shared<pcl::search::KdTree<Point>>());
  estimation.setRadiusSearch(radius);
  pcl::PointCloud<Descriptor> descriptors;
  estimation.compute(descriptors);
  const auto& values = descriptors.front().descriptor;
  return {std::begin(values), std::end(values)};
}

using PclShot = pcl::SHOTEstimation<Point, pcl::Normal, pcl::SHOT352>;
using PclColorShot = pcl::SHOTColorEstimation<Point, pcl::Normal, pcl::SHOT1344>;

void check_normals(const Cloud& cloud, double radius) {
  const NormalCloud expected = pcl_normals(cloud, radius);
  const Normals normals = estimate_normals(cloud.points_view(), radius);
  std::vector<std::uint32_t> expected_bits, bits;
  std::vector<std::int64_t> indices;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const pcl::Normal& n = expected[i];
    if (!std::isfinite(n.normal_x)) continue;
    indices.push_back(static_cast<std::int64_t>(i));
    for (const float value : {n.normal_x, n.normal_y, n.normal_z, n.curvature})
      expected_bits.push_back(std::bit_cast<std::uint32_t>(value));
  }
  for (std::size_t i = 0; i < normals.indices.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k)
      bits.push_back(std::bit_cast<std::uint32_t>(normals.normals[3 * i + k]));
    bits.push_back(std::bit_cast<std::uint32_t>(normals.curvatures[i]));
  }
  CHECK(normals.indices == indices);
  CHECK(bits == expected_bits);
}

void check_descriptors(const Cloud& cloud, double normal_radius) {
  const auto expected = pcl_shot<PclShot, pcl::SHOT352>(cloud, normal_radius, false);
  CHECK(testing::distance(shot(cloud.points_view(), normal_radius), expected) < 1e-5);
  const auto colored = pcl_shot<PclColorShot, pcl::SHOT1344>(cloud, normal_radius, true);
  CHECK(testing::distance(cshot(cloud.points_view(), cloud.colors_view(), normal_radius), colored) <
        1e-5);
}

/// LiDAR scan of a floor and a wall: lines of points, most neighbours along one line.
Cloud scan_lines() {
  std::mt19937 random(5);
  std::normal_distribution<float> noise(0, 0.005F);
  Cloud cloud;
  for (int line = 1; line <= 20; ++line)
    for (int i = 0; i < 200; ++i) {
      const float angle = static_cast<float>(i) * 0.0314F, range = 2.0F + 0.5F * float(line);
      const bool wall = range * std::cos(angle) > 6;
      const float x = wall ? 6 : range * std::cos(angle);
      for (const float value :
           {x, range * std::sin(angle), wall ? 0.3F * static_cast<float>(line) : -1.5F})
        cloud.points.push_back(value + noise(random));
      for (const int shade : {line * 12, i, wall ? 200 : 40})
        cloud.colors.push_back(static_cast<std::uint8_t>(shade));
    }
  return cloud;
}

/// Points in pairs opposite to one another, so that no side has more of them than the other.
Cloud symmetric_cloud() {
  const Cloud half = testing::random_cloud(300);
  Cloud cloud;
  for (std::size_t i = 0; i < half.points.size(); i += 3)
    for (const float sign : {1.0F, -1.0F})
      for (std::size_t k = 0; k < 3; ++k) {
        cloud.points.push_back(sign * half.points[i + k]);
        cloud.colors.push_back(half.colors[i + k]);
      }
  return cloud;
}

Cloud grid(int width, float flatness) {
  Cloud cloud;
  for (int x = 0; x < width; ++x)
    for (int y = 0; y < width; ++y)
      for (int z = 0; z < 3; ++z) {
        for (const float value : {float(x), 2 * float(y), flatness * float(z)})
          cloud.points.push_back(value);
        for (const int value : {x * 9, y * 9, z * 80})
          cloud.colors.push_back(static_cast<std::uint8_t>(value));
      }
  return cloud;
}

TEST_CASE("normals are those of PCL to the last bit") {
  const Cloud cloud = testing::random_cloud(3000);
  for (const double radius : {0.05, 0.5, 1.5, 4.0, 1e3}) check_normals(cloud, radius);
}

TEST_CASE("normals of neighbours along lines are those of PCL to the last bit") {
  const Cloud cloud = scan_lines();
  for (const double radius : {0.1, 0.3, 0.6, 1.2}) check_normals(cloud, radius);
}

TEST_CASE("normals of grids, with many equal distances, are those of PCL to the last bit") {
  for (const float flatness : {0.0F, 0.001F, 1.0F})
    for (const double radius : {1.0, 1.5, 3.0}) check_normals(grid(20, flatness), radius);
}

TEST_CASE("points at one place have no normals, as with PCL") {
  const Cloud cloud{std::vector<float>(3 * 500, 2.5F), {}};
  CHECK(estimate_normals(cloud.points_view(), 1).indices.empty());
  check_normals(cloud, 1);
}

TEST_CASE("SHOT and CSHOT are those of PCL") {
  for (const unsigned seed : {1U, 2U, 3U})
    check_descriptors(testing::random_cloud(5000, seed), 1.0);
  check_descriptors(scan_lines(), 0.5);
  check_descriptors(grid(25, 0.5F), 3.0);
}

TEST_CASE("a cloud with as many points on either side gets PCL's SHOT") {
  check_descriptors(symmetric_cloud(), 6.0);
}

TEST_CASE("SHOT and CSHOT of white and black points are those of PCL") {
  Cloud cloud = testing::random_cloud(2000);
  for (std::size_t i = 0; i < cloud.colors.size(); ++i)
    cloud.colors[i] = i / 3 % 3 == 0 ? 255 : i / 3 % 3 == 1 ? 0 : cloud.colors[i];
  check_descriptors(cloud, 1.0);
}

/// Unit normals and colour distances that mean nothing.
struct Support {
  std::vector<float> values[7];
  detail::ShotSupport view{};

  explicit Support(std::size_t size) {
    std::mt19937 random(static_cast<unsigned>(size));
    std::uniform_real_distribution<float> uniform(-1, 1);
    for (std::size_t i = 0; i < size; ++i) {
      const float x = uniform(random), y = uniform(random), z = uniform(random);
      const float norm = std::sqrt(x * x + y * y + z * z);
      const float row[7] = {3 * uniform(random),
                            uniform(random),
                            0.5F * uniform(random),
                            x / norm,
                            y / norm,
                            z / norm,
                            (1 + uniform(random)) * 0.4F};
      for (std::size_t k = 0; k < 7; ++k) values[k].push_back(row[k]);
    }
    view = {values[0].data(),
            values[1].data(),
            values[2].data(),
            values[3].data(),
            values[4].data(),
            values[5].data(),
            values[6].data(),
            size,
            {0.1F, 0, 0},
            2.5,
            6.25F};
  }
};

TEST_CASE("all levels give the same frame and the same votes") {
  for (const std::size_t size : {20, 255, 256, 257, 5000}) {
    const Support support(size);
    const auto baseline = detail::shot_kernels(SimdLevel::baseline);
    const auto frame = detail::shot_reference_frame(support.view, 1, baseline);
    REQUIRE(frame.has_value());
    std::vector<double> expected(detail::shot_shape_size + detail::shot_color_size);
    baseline.vote(support.view, 0, size, *frame, expected.data());
    for (const SimdLevel level : simd_levels()) {
      const auto kernels = detail::shot_kernels(level);
      for (const int threads : {1, 2}) {
        const auto other = detail::shot_reference_frame(support.view, threads, kernels);
        REQUIRE(other.has_value());
        for (std::size_t k = 0; k < 3; ++k) {
          CHECK(other->x[k] == frame->x[k]);
          CHECK(other->y[k] == frame->y[k]);
          CHECK(other->z[k] == frame->z[k]);
        }
      }
      std::vector<double> votes(expected.size());
      kernels.vote(support.view, 0, size, *frame, votes.data());
      CHECK(votes == expected);
    }
  }
}

TEST_CASE("a keypoint with fewer than five points in its support has no frame") {
  const auto kernels = detail::shot_kernels(best_simd_level());
  CHECK_FALSE(detail::shot_reference_frame(Support(4).view, 1, kernels).has_value());
  Support far(50);
  far.view.squared_radius = 0;
  CHECK_FALSE(detail::shot_reference_frame(far.view, 1, kernels).has_value());
}

}  // namespace
}  // namespace fusionslam
