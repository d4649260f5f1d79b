// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Descriptors beside PCL's own classes.
#include <doctest/doctest.h>
#include <pcl/features/esf.h>
#include <pcl/features/vfh.h>
#include <pcl/point_types.h>

#include <algorithm>
#include <cmath>

#include "clouds.hpp"
#include "descriptors/oriented_points.hpp"
#include "fusionslam/descriptors.hpp"

namespace fusionslam {
namespace {

using detail::OrientedPoints;
using testing::Cloud;

/// A wavy ground and three walls about the origin, with some noise.
Cloud street(std::size_t size, double scale = 1, unsigned seed = 1) {
  std::mt19937 random(seed);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * (random() / 4294967296.0);
  };
  Cloud cloud;
  for (std::size_t i = 0; i < size; ++i) {
    const double u = uniform(-1, 1), v = uniform(-1, 1), noise = uniform(-0.02, 0.02);
    std::array<double, 3> p{15 * u, 8 * v, -1.7 + 0.3 * std::sin(0.5 * u) + noise};
    if (i % 4 == 1) p = {15 * u, 8 + noise, 2 + 3.5 * v};
    if (i % 4 == 2) p = {15 * u, -8 + 1.5 * u + noise, 1 + 2.5 * v};
    if (i % 4 == 3) p = {12 + noise, 6 * u, 1.5 * v};
    for (const double value : p) cloud.points.push_back(static_cast<float>(scale * value));
    for (int c = 0; c < 3; ++c)
      cloud.colors.push_back(static_cast<std::uint8_t>(128 + 90 * u * v + 20 * c * v));
  }
  return cloud;
}

pcl::PointCloud<pcl::PointXYZ>::Ptr pcl_points(PointsView points) {
  auto result = std::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  for (std::size_t i = 0; i < points.size; ++i)
    result->emplace_back(points[i][0], points[i][1], points[i][2]);
  return result;
}

pcl::PointCloud<pcl::Normal>::Ptr pcl_normals(const OrientedPoints& cloud) {
  auto result = std::make_shared<pcl::PointCloud<pcl::Normal>>();
  for (std::size_t i = 0; i < cloud.size(); ++i)
    result->push_back(pcl::Normal(cloud.normal(i)[0], cloud.normal(i)[1], cloud.normal(i)[2],
                                  cloud.curvatures[i]));
  return result;
}

template <class Signature>
std::vector<float> values(const Signature& signature) {
  return {std::begin(signature.histogram), std::end(signature.histogram)};
}

double largest_difference(const std::vector<float>& a, const std::vector<float>& b) {
  double largest = a.size() == b.size() ? 0 : 1e9;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
    largest = std::max(largest, std::abs(static_cast<double>(a[i]) - static_cast<double>(b[i])));
  return largest;
}

TEST_CASE("VFH is PCL's of the same normals") {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    const Cloud cloud = street(2500, 1, seed);
    const OrientedPoints oriented =
        detail::oriented_points(cloud.points_view(), {}, 1.0, 0, 1, "VFH");
    REQUIRE(oriented.size() > 300);
    pcl::VFHEstimation<pcl::PointXYZ, pcl::Normal, pcl::VFHSignature308> estimation;
    estimation.setInputCloud(pcl_points(oriented.points_view()));
    estimation.setInputNormals(pcl_normals(oriented));
    estimation.setNormalizeDistance(true);
    estimation.setFillSizeComponent(true);
    pcl::PointCloud<pcl::VFHSignature308> found;
    estimation.compute(found);
    const auto own = vfh(cloud.points_view(), {1.0, 0});
    CHECK(largest_difference(own, values(found[0])) < 1e-4);
  }
}

TEST_CASE("ESF is distributed as PCL's, which draws by the clock") {
  const Cloud cloud = street(4000);
  pcl::ESFEstimation<pcl::PointXYZ, pcl::ESFSignature640> estimation;
  estimation.setInputCloud(pcl_points(cloud.points_view()));
  pcl::PointCloud<pcl::ESFSignature640> found;
  estimation.compute(found);
  const auto pcls = values(found[0]), own = esf(cloud.points_view());
  // Counts of 20,000 triangles, 60,000 lines: a bin that holds a share s of a histogram of n
  // has a standard deviation of sqrt(s / n); both are drawn. The ten histograms add up to 1.
  double difference = 0;
  for (std::size_t i = 0; i < own.size(); ++i) {
    difference += std::abs(static_cast<double>(own[i]) - static_cast<double>(pcls[i]));
    const double larger = std::max(own[i], pcls[i]);
    CHECK(std::abs(own[i] - pcls[i]) < 6 * std::sqrt(2 * larger / 20000) + 1e-3);
  }
  CHECK(difference < 0.05);
}

}  // namespace
}  // namespace fusionslam
