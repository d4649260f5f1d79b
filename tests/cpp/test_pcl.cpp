// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>
#include <pcl/console/print.h>

#include <thread>

#include "clouds.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/fusion.hpp"
#include "fusionslam/pcl.hpp"

namespace fusionslam {
namespace {

using testing::Cloud;

pcl::PointCloud<pcl::PointXYZRGB> pcl_cloud(const Cloud& cloud) {
  pcl::PointCloud<pcl::PointXYZRGB> result;
  for (std::size_t i = 0; i < cloud.points.size(); i += 3) {
    const float* p = cloud.points.data() + i;
    const std::uint8_t* c = cloud.colors.data() + i;
    result.push_back(pcl::PointXYZRGB(p[0], p[1], p[2], c[0], c[1], c[2]));
  }
  return result;
}

TEST_CASE("a PCL cloud is viewed where it lies") {
  const auto cloud = pcl_cloud(testing::random_cloud(20));
  const PointsView points = points_view(cloud);
  const ColorsView colors = colors_view(cloud);
  REQUIRE(points.size == 20);
  REQUIRE(colors.size == 20);
  for (std::size_t i = 0; i < 20; ++i) {
    CHECK(points[i] == &cloud[i].x);
    CHECK(colors.data + i * colors.stride == &cloud[i].r);
    CHECK(colors.at(i, 1) == cloud[i].g);
    CHECK(colors.at(i, 2) == cloud[i].b);
  }
}

TEST_CASE("other PCL points are viewed too") {
  pcl::PointCloud<pcl::PointXYZ> plain;
  plain.emplace_back(1.0F, 2.0F, 3.0F);
  plain.emplace_back(4.0F, 5.0F, 6.0F);
  CHECK(points_view(plain)[1] == &plain[1].x);
  pcl::PointCloud<pcl::PointXYZRGBNormal> rich;
  rich.resize(3);
  CHECK(points_view(rich)[2] == &rich[2].x);
  CHECK(colors_view(rich).data + 2 * colors_view(rich).stride == &rich[2].r);
}

TEST_CASE("an empty PCL cloud is an empty view") {
  const pcl::PointCloud<pcl::PointXYZRGB> cloud;
  CHECK(points_view(cloud).size == 0);
  CHECK(colors_view(cloud).size == 0);
  CHECK_THROWS_AS(m2dp(points_view(cloud)), DataError);
}

TEST_CASE("a PCL cloud has the descriptors of the same plain arrays") {
  const Cloud plain = testing::random_cloud(2000);
  const auto cloud = pcl_cloud(plain);
  const PointsView points = plain.points_view();
  const ColorsView colors = plain.colors_view();
  CHECK(m2dp(points_view(cloud)) == m2dp(points));
  CHECK(cm2dp(points_view(cloud), colors_view(cloud)) == cm2dp(points, colors));
  CHECK(shot(points_view(cloud), 1.0) == shot(points, 1.0));
  CHECK(cshot(points_view(cloud), colors_view(cloud), 1.0) == cshot(points, colors, 1.0));
}

TEST_CASE("PCL prints as much as before after calls at once that quietened it") {
  const std::vector<float> line{0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0};
  const auto before = pcl::console::getVerbosityLevel();
  const auto search = [&] {
    for (int i = 0; i < 50; ++i) remove_ground_plane({line.data(), 4});
  };
  {
    const std::jthread thread(search);
    search();
  }
  CHECK(pcl::console::getVerbosityLevel() == before);
}

}  // namespace
}  // namespace fusionslam
