// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The neighbour searches against comparing all with all.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <vector>

#include "clouds.hpp"
#include "descriptors/ordered_neighbors.hpp"
#include "descriptors/surface_normals.hpp"
#include "levels.hpp"
#include "refused.hpp"

namespace fusionslam::detail {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();

PointsView view(const std::vector<float>& points) { return {points.data(), points.size() / 3}; }

float squared_distance(const std::vector<float>& points, std::size_t i, std::size_t j) {
  const float x = points[3 * i] - points[3 * j], y = points[3 * i + 1] - points[3 * j + 1];
  const float z = points[3 * i + 2] - points[3 * j + 2];
  return x * x + y * y + z * z;
}

std::vector<std::size_t> naive_neighbors(const std::vector<float>& points, std::size_t i,
                                         float squared_radius) {
  std::vector<std::pair<float, std::size_t>> found;
  for (std::size_t j = 0; j < points.size() / 3; ++j)
    if (const float squared = squared_distance(points, i, j); squared < squared_radius)
      found.emplace_back(squared, j);
  std::sort(found.begin(), found.end());
  std::vector<std::size_t> result;
  for (const auto& [squared, j] : found) result.push_back(j);
  return result;
}

/// By the number of the point.
std::vector<std::vector<std::size_t>> neighbors(const std::vector<float>& points,
                                                float squared_radius, SimdLevel level) {
  const PointBlocks cloud(view(points), 1, level);
  OrderedNeighbors search(cloud, squared_radius);
  std::vector<std::vector<std::size_t>> result(cloud.size());
  for (std::size_t place = 0; place < cloud.size(); ++place) {
    if (place % block_size == 0) search.enter(place / block_size);
    auto& own = result[cloud.indices()[place]];
    for (const std::uint32_t other : search.of(place)) own.push_back(cloud.indices()[other]);
  }
  return result;
}

void check_neighbors(const std::vector<float>& points, float squared_radius) {
  for (const SimdLevel level : simd_levels()) {
    const auto found = neighbors(points, squared_radius, level);
    REQUIRE(found.size() == points.size() / 3);
    std::size_t wrong = 0;
    for (std::size_t i = 0; i < found.size(); ++i)
      wrong += found[i] != naive_neighbors(points, i, squared_radius);
    CHECK(wrong == 0);
  }
}

double naive_resolution(const std::vector<float>& points) {
  const std::size_t size = points.size() / 3;
  double sum = 0;
  for (std::size_t i = 0; i < size; ++i) {
    float nearest = infinity;
    for (std::size_t j = 0; j < size; ++j)
      if (j != i) nearest = std::min(nearest, squared_distance(points, i, j));
    sum += std::sqrt(static_cast<double>(nearest));
  }
  return sum / static_cast<double>(size);
}

void check_resolution(const std::vector<float>& points) {
  for (const SimdLevel level : simd_levels())
    for (const int threads : {1, 2})
      CHECK(resolution(PointBlocks(view(points), 1, level), threads) == naive_resolution(points));
}

/// Whole numbers: many distances are equal, many exactly the radius.
std::vector<float> lattice(int width) {
  std::vector<float> points;
  for (int x = 0; x < width; ++x)
    for (int y = 0; y < width; ++y)
      for (int z = 0; z < width; ++z)
        for (const int value : {x, y, z}) points.push_back(static_cast<float>(value));
  std::mt19937 random(2);
  for (std::size_t i = points.size() / 3 - 1; i > 0; --i)
    std::swap_ranges(points.begin() + static_cast<std::ptrdiff_t>(3 * i),
                     points.begin() + static_cast<std::ptrdiff_t>(3 * i + 3),
                     points.begin() + static_cast<std::ptrdiff_t>(3 * (random() % (i + 1))));
  return points;
}

/// Two dense clumps far apart, a scattered rest, and one outlier at the end of the world.
std::vector<float> uneven_cloud() {
  std::mt19937 random(3);
  std::normal_distribution<float> normal;
  std::vector<float> points;
  for (int i = 0; i < 900; ++i)
    for (int axis = 0; axis < 3; ++axis)
      points.push_back((i % 3 == 0   ? 1e-3F
                        : i % 3 == 1 ? 1e-5F
                                     : 100.0F) *
                           normal(random) +
                       (i % 3 == 1 ? 50.0F : 0.0F));
  points.insert(points.end(), {1e14F, -1e14F, 3.0F});
  return points;
}

TEST_CASE("neighbours and their order are those of comparing all with all, for any size") {
  for (const std::size_t size : {3, 15, 16, 17, 255, 256, 257, 1000}) {
    const auto cloud = testing::random_cloud(size);
    for (const float squared_radius : {0.0F, 0.3F, 6.0F, infinity})
      check_neighbors(cloud.points, squared_radius);
  }
}

TEST_CASE("a cloud of more than one level of groups is searched completely") {
  const auto points = testing::random_cloud(5000).points;
  const auto found = neighbors(points, 0.5F, best_simd_level());
  for (std::size_t i = 0; i < 5000; i += 7) CHECK(found[i] == naive_neighbors(points, i, 0.5F));
}

TEST_CASE("equal distances keep the order of the cloud, and points at the radius are outside") {
  for (const float squared_radius : {1.0F, 2.0F, 9.0F, 49.0F})
    check_neighbors(lattice(8), squared_radius);
}

TEST_CASE("points at one place are neighbours of one another") {
  check_neighbors(std::vector<float>(3 * 70, 0.5F), 1e-6F);   // ranked
  check_neighbors(std::vector<float>(3 * 300, 0.5F), 1e-6F);  // sorted
}

TEST_CASE("dense clumps, scattered points and an outlier are searched together") {
  for (const float squared_radius : {1e-10F, 1e-5F, 1e4F, 1e29F})
    check_neighbors(uneven_cloud(), squared_radius);
}

TEST_CASE("the resolution is exactly that of comparing all with all") {
  for (const std::size_t size : {2, 16, 17, 257, 5000})
    check_resolution(testing::random_cloud(size).points);
  check_resolution(lattice(7));
  check_resolution(uneven_cloud());
  check_resolution(std::vector<float>(3 * 40, 1.5F));
}

TEST_CASE("distances that overflow are refused") {
  auto points = testing::random_cloud(20).points;
  for (float& value : points) value *= 1e29F;
  for (const auto& call : std::vector<std::function<void()>>{
           [&] { cloud_resolution(view(points)); }, [&] { estimate_normals(view(points), 1); },
           [&] { shot(view(points)); }})
    testing::check_refused<DataError>(call, "beyond 1e15 m");
}

}  // namespace
}  // namespace fusionslam::detail
