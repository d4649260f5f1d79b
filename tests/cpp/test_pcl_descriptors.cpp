// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Descriptors beside PCL's own classes.
#include <doctest/doctest.h>
#include <pcl/features/cvfh.h>
#include <pcl/features/esf.h>
#include <pcl/features/gasd.h>
#include <pcl/features/our_cvfh.h>
#include <pcl/features/vfh.h>
#include <pcl/point_types.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "clouds.hpp"
#include "descriptors/vfh_histogram.hpp"
#include "fusionslam/descriptors.hpp"

namespace fusionslam {
namespace {

using detail::OrientedPoints;
using testing::Cloud;

/// Of histograms that sum to 100, as PCL adds up a float for each of some thousand points. A point
/// in another bin would make a difference of 0.03 or more.
constexpr double tolerance = 1e-3;

/// A wavy ground and three walls about the origin, with some noise, 2.5 m or more apart: PCL skips
/// the first neighbour that it finds of a point, be it the point itself or not, and so may lose
/// points that hang on to a region by one neighbour.
Cloud street(std::size_t size, double scale = 1, unsigned seed = 1) {
  std::mt19937 random(seed);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * (random() / 4294967296.0);
  };
  Cloud cloud;
  for (std::size_t i = 0; i < size; ++i) {
    const double u = uniform(-1, 1), v = uniform(-1, 1), noise = uniform(-0.02, 0.02);
    std::array<double, 3> p{15 * u, 8 * v, -1.7 + 0.3 * std::sin(0.5 * u) + noise};
    if (i % 4 == 1) p = {15 * u, 8 + noise, 5 + 3.5 * v};
    if (i % 4 == 2) p = {15 * u, -9 + 1.5 * u + noise, 4 + 2.5 * v};
    if (i % 4 == 3) p = {12 + noise, 5 * u, 3 + 1.8 * v};
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
    // Where PCL computes the centroid itself, a fourth coordinate of 1 gets into its distances.
    const detail::VfhCenter center = detail::mean_center(oriented);
    estimation.setUseGivenCentroid(true);
    estimation.setCentroidToUse({center.point[0], center.point[1], center.point[2]});
    estimation.setUseGivenNormal(true);
    estimation.setNormalToUse({center.normal[0], center.normal[1], center.normal[2]});
    estimation.setNormalizeDistance(true);
    estimation.setFillSizeComponent(true);
    pcl::PointCloud<pcl::VFHSignature308> found;
    estimation.compute(found);
    const auto own = vfh(cloud.points_view(), {1.0, 0});
    CHECK(largest_difference(own, values(found[0])) < tolerance);
  }
}

constexpr std::size_t block_size = 308;

/// CVFH or OUR-CVFH of PCL, a block after another.
template <template <class, class, class> class Estimation>
std::vector<float> region_blocks(const OrientedPoints& cloud, float leaf) {
  Estimation<pcl::PointXYZ, pcl::Normal, pcl::VFHSignature308> estimation;
  estimation.setInputCloud(pcl_points(cloud.points_view()));
  estimation.setInputNormals(pcl_normals(cloud));
  estimation.setRadiusNormals(3 * leaf);
  estimation.setClusterTolerance(3 * leaf);
  estimation.setNormalizeBins(true);
  pcl::PointCloud<pcl::VFHSignature308> found;
  estimation.compute(found);
  std::vector<float> blocks;
  for (const auto& signature : found)
    blocks.insert(blocks.end(), std::begin(signature.histogram), std::end(signature.histogram));
  return blocks;
}

std::vector<std::vector<float>> split_blocks(const std::vector<float>& descriptor) {
  std::vector<std::vector<float>> blocks;
  for (auto block = descriptor.begin(); block != descriptor.end(); block += block_size)
    if (std::any_of(block, block + block_size, [](float value) { return value != 0; }))
      blocks.emplace_back(block, block + block_size);
  return blocks;
}

/// Both have the same blocks, whose order PCL leaves to the order of the points.
void check_same_blocks(const std::vector<float>& own, const std::vector<float>& pcls) {
  const auto blocks = split_blocks(own), expected = split_blocks(pcls);
  REQUIRE(blocks.size() >= 3);
  CHECK(blocks.size() == expected.size());
  for (const auto& block : blocks) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const auto& other : expected)
      nearest = std::min(nearest, largest_difference(block, other));
    CHECK(nearest < tolerance);
  }
}

TEST_CASE("CVFH has PCL's histograms of the same regions") {
  const Cloud cloud = street(4000);
  const OrientedPoints oriented =
      detail::oriented_points(cloud.points_view(), {}, 0.8, 0, 1, "CVFH");
  check_same_blocks(cvfh(cloud.points_view(), {0.8, 0, 64, 50, 0.03, 0.125}),
                    region_blocks<pcl::CVFHEstimation>(oriented, 0.8F));
}

TEST_CASE("OUR-CVFH has PCL's histograms of the same regions") {
  // PCL's soft border between octants is made for leaves of 5 mm.
  const Cloud cloud = street(4000, 0.005 / 0.8);
  const OrientedPoints oriented =
      detail::oriented_points(cloud.points_view(), {}, 0.005, 0, 1, "OUR-CVFH");
  check_same_blocks(our_cvfh(cloud.points_view(), {0.005, 0, 64, 50, 0.03, 0.125}),
                    region_blocks<pcl::OURCVFHEstimation>(oriented, 0.005F));
}

/// The descriptor of the cloud turned by half a turn about the frame's z axis.
std::vector<float> turned_by_half(const std::vector<float>& gasd) {
  std::vector<float> result(gasd.size());
  const auto turn = [&](std::size_t begin, std::size_t cells, std::size_t values) {
    for (std::size_t x = 0; x < cells; ++x)
      for (std::size_t y = 0; y < cells; ++y)
        for (std::size_t z = 0; z < cells; ++z)
          for (std::size_t i = 0; i < values; ++i)
            result[begin + ((x * cells + y) * cells + z) * values + i] =
                gasd[begin + (((cells - 1 - x) * cells + cells - 1 - y) * cells + z) * values + i];
  };
  turn(0, 6, 1);
  turn(216, 4, 12);
  return result;
}

TEST_CASE("GASD with colour is PCL's but for the sign of x, and what lies on the cube's faces") {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    const Cloud cloud = street(800, 1, seed);
    auto colored = std::make_shared<pcl::PointCloud<pcl::PointXYZRGB>>();
    for (std::size_t i = 0; i < cloud.points_view().size; ++i) {
      const float* p = cloud.points_view()[i];
      const std::uint8_t* c = cloud.colors.data() + 3 * i;
      colored->push_back(pcl::PointXYZRGB(p[0], p[1], p[2], c[0], c[1], c[2]));
    }
    pcl::GASDColorEstimation<pcl::PointXYZRGB, pcl::GASDSignature984> estimation;
    estimation.setInputCloud(colored);
    pcl::PointCloud<pcl::GASDSignature984> found;
    estimation.compute(found);
    const auto own = gasd_color(cloud.points_view(), cloud.colors_view());
    const auto pcls = values(found[0]);
    // Turned by half a turn, the point that sets the size of the cube may fall on another face.
    const double as_is = largest_difference(own, pcls);
    const double turned = largest_difference(turned_by_half(own), pcls);
    CHECK(std::min(as_is, turned) < tolerance + (as_is < turned ? 0 : 100.0 / 799));
  }
}

TEST_CASE("ESF is distributed as PCL's, which draws by the clock") {
  const Cloud cloud = street(4000);
  pcl::ESFEstimation<pcl::PointXYZ, pcl::ESFSignature640> estimation;
  estimation.setInputCloud(pcl_points(cloud.points_view()));
  pcl::PointCloud<pcl::ESFSignature640> found;
  estimation.compute(found);
  const auto pcls = values(found[0]), own = esf(cloud.points_view());
  // Other triangles of the same cloud: those of its points in reverse order.
  Cloud reversed;
  for (std::size_t i = cloud.points.size(); i > 0; i -= 3)
    reversed.points.insert(reversed.points.end(), cloud.points.begin() + static_cast<long>(i) - 3,
                           cloud.points.begin() + static_cast<long>(i));
  const auto again = esf(reversed.points_view());
  const auto difference = [](const std::vector<float>& a, const std::vector<float>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
      sum += std::abs(static_cast<double>(a[i]) - static_cast<double>(b[i]));
    return sum;
  };
  const double sampling = difference(own, again);
  CHECK(sampling > 0.01);
  CHECK(sampling < 0.12);
  CHECK(difference(own, pcls) < 1.5 * sampling);
  CHECK(difference(again, pcls) < 1.5 * sampling);
}

}  // namespace
}  // namespace fusionslam
