// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include "clouds.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/fusion.hpp"

namespace fusionslam {
namespace {

using testing::Cloud;

TEST_CASE("a points view walks in strides") {
  const Cloud cloud = testing::random_cloud(50);
  const auto values = testing::strided(cloud, 7);
  const PointsView view{values.data(), 50, 7};
  for (std::size_t i = 0; i < view.size; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis) CHECK(view[i][axis] == cloud.points[3 * i + axis]);
}

TEST_CASE("a colours view reads BGR from behind") {
  const std::vector<std::uint8_t> bgra{3, 2, 1, 255, 30, 20, 10, 255};
  const ColorsView view{bgra.data() + 2, 2, 4, -1};
  CHECK(view.at(0, 0) == 1);
  CHECK(view.at(0, 1) == 2);
  CHECK(view.at(0, 2) == 3);
  CHECK(view.at(1, 0) == 10);
  CHECK(view.at(1, 2) == 30);
}

TEST_CASE("an image view skips the padding of its rows") {
  const std::vector<std::uint8_t> bytes{1, 2, 3, 4, 5, 6, 0, 0, 7, 8, 9, 10, 11, 12, 0, 0};
  const ImageView image{bytes.data(), 2, 2, 3, 8};
  CHECK(*image.pixel(0, 1) == 4);
  CHECK(*image.pixel(1, 0) == 7);
  CHECK(*image.pixel(1, 1) == 10);
}

TEST_CASE("a coloured cloud views itself") {
  const ColoredCloud cloud{{1, 2, 3, 4, 5, 6}, {7, 8, 9, 10, 11, 12}, {0, 5}};
  CHECK(cloud.size() == 2);
  CHECK(cloud.points_view().data == cloud.points.data());
  CHECK(cloud.points_view().size == 2);
  CHECK(cloud.colors_view().at(1, 2) == 12);
}

TEST_CASE("strides and the order of the channels do not change a descriptor") {
  const Cloud cloud = testing::random_cloud(2000);
  const auto values = testing::strided(cloud, 5);
  std::vector<std::uint8_t> bgra;
  for (std::size_t i = 0; i < cloud.colors.size(); i += 3)
    bgra.insert(bgra.end(), {cloud.colors[i + 2], cloud.colors[i + 1], cloud.colors[i], 255});
  const PointsView points{values.data(), 2000, 5};
  const ColorsView colors{bgra.data() + 2, 2000, 4, -1};
  CHECK(m2dp(points) == m2dp(cloud.points_view()));
  CHECK(cm2dp(points, colors) == cm2dp(cloud.points_view(), cloud.colors_view()));
  CHECK(cshot(points, colors, 1.0) == cshot(cloud.points_view(), cloud.colors_view(), 1.0));
}

TEST_CASE("strides do not change the filters") {
  const Cloud cloud = testing::random_cloud(500);
  const auto values = testing::strided(cloud, 4);
  const PointsView points{values.data(), 500, 4};
  const auto plain = voxel_downsample(cloud.points_view(), cloud.colors_view(), 2.0);
  const auto wide = voxel_downsample(points, cloud.colors_view(), 2.0);
  CHECK(wide.points == plain.points);
  CHECK(wide.colors == plain.colors);
  CHECK(drop_invalid(points).size() == 500);
  CHECK(above_height(points, 1.0) == above_height(cloud.points_view(), 1.0));
}

}  // namespace
}  // namespace fusionslam
