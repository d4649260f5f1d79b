// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Finding the points that an image sees, against a plain loop, on every SIMD level.
#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "fusion/projection.hpp"
#include "levels.hpp"

namespace fusionslam::detail {
namespace {

constexpr int width = 100, height = 80;
constexpr Projection camera{100, 0, 50, 3, 0, 100, 40, -2, 0, 0.01, 1, 0.5};

std::vector<float> random_points(std::size_t size, std::size_t stride, float extent = 4) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(-extent, extent);
  std::vector<float> points(size * stride + 1);
  for (float& value : points) value = uniform(random);
  return points;
}

/// As the header says it, one point after the other, with a floor.
std::vector<int> plainly_visible(PointsView points) {
  std::vector<int> visible;
  for (std::size_t i = 0; i < points.size; ++i) {
    double h[3];
    for (std::size_t row = 0; row < 3; ++row)
      h[row] = camera[4 * row] * points[i][0] + camera[4 * row + 1] * points[i][1] +
               camera[4 * row + 2] * points[i][2] + camera[4 * row + 3];
    const double column = std::floor(h[0] / h[2] + 0.5), line = std::floor(h[1] / h[2] + 0.5);
    if (h[2] > 0 && column >= 0 && line >= 0 && column < width && line < height)
      visible.push_back(static_cast<int>(i));
  }
  return visible;
}

std::vector<int> candidates(PointsView points, SimdLevel level) {
  int list[point_block];
  std::int32_t largest = 0;
  const int count = frustum_kernel(level)({points.data, points.stride, points.size},
                                          frustum_of(camera, width, height), list, largest);
  return {list, list + count};
}

TEST_CASE("what is visible is what a plain loop finds, for any stride, size and extent") {
  for (const std::size_t stride : {3UL, 4UL, 7UL})
    for (const std::size_t size : {0UL, 1UL, 7UL, 255UL, 256UL, 257UL, 5000UL})
      for (const float extent : {4.0F, 1e6F, 1e-30F, 1e38F}) {
        INFO("stride ", stride, " size ", size, " extent ", extent);
        const auto data = random_points(size, stride, extent);
        const PointsView points{data.data() + 1, size, stride};
        std::vector<int> found;
        for_each_visible(points, camera, width, height, [&](std::size_t i, const Pixel& pixel) {
          found.push_back(static_cast<int>(i));
          CHECK(pixel.column() == std::floor(pixel.u + 0.5));
        });
        CHECK(found == plainly_visible(points));
      }
}

TEST_CASE("points on the very borders of the image are not lost to rounding in float") {
  std::vector<float> data;
  for (int i = 0; i < 80; ++i) {
    const float depth = 0.1F + static_cast<float>(i);
    for (const double u : {-0.5, 99.5 - 1e-9}) {
      const double y = 0.3 * depth;
      const double w = 0.01 * y + depth + 0.5;
      data.insert(data.end(), {static_cast<float>((u * w - 50 * depth - 3) / 100),
                               static_cast<float>(y), depth});
    }
  }
  const PointsView points{data.data(), data.size() / 3};
  std::size_t found = 0;
  for_each_visible(points, camera, width, height, [&](std::size_t, const Pixel&) { ++found; });
  CHECK(found == plainly_visible(points).size());
  CHECK(found > 0);
  CHECK(found < points.size);
}

TEST_CASE("every level lists the same candidates, and few that are not visible") {
  const auto data = random_points(256, 3);
  const PointsView points{data.data(), 256};
  const auto expected = candidates(points, SimdLevel::baseline);
  CHECK(expected.size() <= plainly_visible(points).size() + 2);
  for (const SimdLevel level : simd_levels()) CHECK(candidates(points, level) == expected);
}

TEST_CASE("a point that is not finite is refused by its number") {
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity()}) {
    auto data = random_points(600, 3);
    data[3 * 300 + 1] = bad;
    const auto nothing = [](std::size_t, const Pixel&) {};
    CHECK_THROWS_WITH_AS(for_each_visible({data.data(), 600}, camera, width, height, nothing),
                         "point 300 is not finite; drop such points first (drop_invalid)",
                         DataError);
  }
}

}  // namespace
}  // namespace fusionslam::detail
