// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The fast counting loop: the same votes on every SIMD level and for any number of threads, and
// those of the plain loop with sqrt and atan2 but for points at the very edges.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <random>
#include <tuple>
#include <vector>

#include "descriptors/m2dp_fast_kernel.hpp"
#include "descriptors/projection_planes.hpp"
#include "descriptors/votes.hpp"
#include "levels.hpp"

namespace fusionslam::detail {
namespace {

using std::numbers::pi;

constexpr KernelFrame identity{{0, 0, 0}, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};

struct Cloud {
  std::vector<float> points;
  std::vector<std::uint8_t> colors;

  std::size_t size() const { return points.size() / 3; }
  RawPoints raw() const { return {points.data(), 3, size()}; }
  ColorsView colors_view() const { return {colors.data(), size()}; }
  void add(float x, float y, float z) {
    points.insert(points.end(), {x, y, z});
    for (std::size_t c = 0; c < 3; ++c)
      colors.push_back(static_cast<std::uint8_t>(size() * (37 + 41 * c)));
  }
};

Cloud random_cloud(std::size_t size, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0, 0.2F);
  Cloud cloud;
  for (std::size_t i = 0; i < size; ++i)
    cloud.add(normal(random), 0.7F * normal(random), 0.3F * normal(random));
  return cloud;
}

/// Colour bins that need no table: a byte over 16.
const ColorBinner& plain_colors(const Cloud& cloud, ColorBinner& place) {
  M2dpConfig config;
  config.grey_world = false;
  place = ColorBinner(cloud.colors_view(), ColorSpace::rgb, config);
  return place;
}

Signature votes_of(const Cloud& cloud, bool colored, SimdLevel level, int threads = 1,
                   const M2dpConfig& config = {}) {
  ColorBinner binner(cloud.colors_view(), ColorSpace::rgb, config);
  const VoteTask task{cloud.raw(), identity, colored ? &plain_colors(cloud, binner) : nullptr};
  return count_votes(task, mirrored_planes(config.azimuths, config.elevations), config, level,
                     threads);
}

struct Place {
  double ring, sector;  ///< as real numbers; the bin is the floor
};

Place place_on(const KernelPlane& plane, const float* p) {
  const auto along = [&](const double* axis) {
    return p[0] * axis[0] + p[1] * axis[1] + p[2] * axis[2];
  };
  const double x = along(plane.x_axis), y = along(plane.y_axis);
  return {std::sqrt(std::sqrt(x * x + y * y)) * fast_rings,
          (std::atan2(y, x) + pi) / (2 * pi) * fast_sectors};
}

int bin_of(const Place& place) {
  const int ring = std::min(static_cast<int>(place.ring), fast_rings - 1);
  const int sector = std::min(static_cast<int>(place.sector), fast_sectors - 1);
  return ring * fast_sectors + sector;
}

double distance_from_edge(const Place& place) {
  const auto from_whole = [](double value) { return std::fabs(value - std::round(value)); };
  return std::min(from_whole(place.ring), from_whole(place.sector));
}

/// The bin of the single vote that one point gives to one plane; -1 if it is not a single one.
int only_bin(const Signature& votes, int row) {
  int found = -1;
  for (int bin = 0; bin < fast_rings * fast_sectors; ++bin) {
    const double count = votes.values[static_cast<std::size_t>(row * votes.columns + bin)];
    if (count == 0) continue;
    if (count != 1 || found >= 0) return -1;
    found = bin;
  }
  return found;
}

Cloud single(const Cloud& cloud, std::size_t i) {
  Cloud one;
  one.add(cloud.points[3 * i], cloud.points[3 * i + 1], cloud.points[3 * i + 2]);
  return one;
}

TEST_CASE("a vote differs from that of sqrt and atan2 only within 1e-5 of an edge, and rarely") {
  const auto planes = mirrored_planes(8, 8);
  const Cloud cloud = random_cloud(5000);
  std::size_t differing = 0, far = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Signature votes = votes_of(single(cloud, i), false, best_simd_level());
    for (int row = 0; row < votes.rows; ++row) {
      const Place place = place_on(planes[static_cast<std::size_t>(row)], &cloud.points[3 * i]);
      if (only_bin(votes, row) == bin_of(place)) continue;
      ++differing;
      far += distance_from_edge(place) > 1e-5;
    }
  }
  CHECK(far == 0);
  CHECK(differing * 100000 <= cloud.size() * planes.size());
}

TEST_CASE("points on the axes, the diagonals and in the middle count where atan2 puts them") {
  const KernelPlane flat{{1, 0, 0}, {0, 1, 0}};
  M2dpConfig config;
  for (const SimdLevel level : simd_levels()) {
    for (const auto& [x, y, sector] : {std::tuple{0.5F, 0.0F, 8},
                                       {0.5F, -0.0F, 8},
                                       {0.5F, 0.5F, 10},
                                       {0.0F, 0.5F, 12},
                                       {-0.0F, 0.5F, 12},
                                       {-0.5F, 0.5F, 14},
                                       {-0.5F, 0.0F, 15},
                                       {-0.5F, -0.5F, 2},
                                       {0.0F, -0.5F, 4},
                                       {-0.0F, -0.5F, 4},
                                       {0.5F, -0.5F, 6},
                                       {0.0F, 0.0F, 8},
                                       {-0.0F, -0.0F, 8}}) {
      INFO(choice_name(level), " ", x, " ", y);
      Cloud cloud;
      cloud.add(x, y, 0);
      const VoteTask task{cloud.raw(), identity};
      const Signature votes = count_votes(task, {flat}, config, level, 1);
      CHECK(only_bin(votes, 0) % fast_sectors == sector);
    }
  }
}

TEST_CASE("a point on a ring's edge counts in the outer ring") {
  const KernelPlane flat{{1, 0, 0}, {0, 1, 0}};
  for (const SimdLevel level : simd_levels())
    for (int ring = 1; ring <= 9; ++ring) {
      const float radius = static_cast<float>(ring * ring) / 64;
      Cloud cloud;
      cloud.add(radius, 0, 0);
      const Signature votes = count_votes({cloud.raw(), identity}, {flat}, {}, level, 1);
      CHECK(only_bin(votes, 0) / fast_sectors == std::min(ring, 7));
    }
}

TEST_CASE("every level and any number of threads count the same, for sizes round a block") {
  for (const std::size_t size : {0UL, 1UL, 15UL, 17UL, 239UL, 240UL, 241UL, 5000UL, 70000UL})
    for (const bool colored : {false, true}) {
      INFO(size, colored ? " coloured" : "");
      const Cloud cloud = random_cloud(size, 2);
      const auto expected = votes_of(cloud, colored, SimdLevel::baseline).values;
      for (const SimdLevel level : simd_levels())
        for (const int threads : {1, 2, 5})
          CHECK(votes_of(cloud, colored, level, threads).values == expected);
    }
}

TEST_CASE("each row holds every point once for shape and once a channel") {
  const Cloud cloud = random_cloud(1000);
  const Signature votes = votes_of(cloud, true, best_simd_level());
  for (int row = 0; row < votes.rows; ++row) {
    const auto begin = votes.values.begin() + row * votes.columns;
    CHECK(std::accumulate(begin, begin + 128, 0.0) == 1000);
    for (int channel = 0; channel < 3; ++channel)
      CHECK(std::accumulate(begin + 128 + 128 * channel, begin + 256 + 128 * channel, 0.0) == 1000);
  }
}

TEST_CASE("colours stand in the ring and bin of their point") {
  Cloud cloud;
  cloud.add(0.3F, 0.1F, 0.05F);
  cloud.colors = {255, 0, 100};
  const Signature votes = votes_of(cloud, true, best_simd_level());
  for (int row = 0; row < votes.rows; ++row) {
    const int ring = only_bin(votes, row) / fast_sectors;
    for (int channel = 0; channel < 3; ++channel) {
      const int bin = cloud.colors[static_cast<std::size_t>(channel)] / 16;
      CHECK(votes.values[static_cast<std::size_t>(row * votes.columns + 128 + 128 * channel +
                                                  ring * 16 + bin)] == 1);
    }
  }
}

TEST_CASE("more than 2^24 points in one bin are all counted") {
  const std::size_t size = (std::size_t{1} << 24) + 300;
  const std::vector<float> point{0.3F, 0.2F, 0.1F};
  const std::vector<std::uint8_t> color{10, 20, 30};
  const ColorsView colors{color.data(), size, 0};  // one colour over and over
  M2dpConfig config;
  config.grey_world = false;
  config.azimuths = 4;
  config.elevations = 2;
  const ColorBinner binner(colors, ColorSpace::rgb, config);
  const VoteTask task{{point.data(), 0, size}, identity, &binner};
  const Signature votes = count_votes(task, mirrored_planes(4, 2), config, simd_level(), 2);
  for (int row = 0; row < votes.rows; ++row) {
    const auto begin = votes.values.begin() + row * votes.columns;
    CHECK(*std::max_element(begin, begin + 128) == static_cast<double>(size));
    CHECK(std::count(begin, begin + votes.columns, static_cast<double>(size)) == 4);
  }
}

TEST_CASE("other sizes than the papers' are counted too, alike for any number of threads") {
  M2dpConfig config;
  config.rings = 5;
  config.sectors = 12;
  config.color_bins = 20;
  const Cloud cloud = random_cloud(20000);
  const auto expected = votes_of(cloud, true, SimdLevel::baseline, 1, config);
  CHECK(std::accumulate(expected.values.begin(), expected.values.end(), 0.0) == 20000.0 * 64 * 4);
  CHECK(votes_of(cloud, true, SimdLevel::baseline, 3, config).values == expected.values);
}

TEST_CASE("fewer colour bins than 16 count on the fast path") {
  M2dpConfig config;
  config.color_bins = 5;
  const auto planes = mirrored_planes(8, 8);
  CHECK(is_fast_case(config, planes));
  const Cloud cloud = random_cloud(500);
  const ColorBinner binner(cloud.colors_view(), ColorSpace::rgb, config);
  const VoteTask task{cloud.raw(), identity, &binner};
  const Signature votes = count_votes(task, planes, config, simd_level(), 1);
  CHECK(votes.columns == 128 + 8 * 15);
  CHECK(std::accumulate(votes.values.begin(), votes.values.end(), 0.0) == 500.0 * 64 * 4);
}

TEST_CASE("a plane without extent takes the plain path, which counts at angle 0") {
  const std::vector<KernelPlane> planes{{{0, 0, 0}, {0, 0, 0}}};
  CHECK_FALSE(is_fast_case({}, planes));
  const Cloud cloud = random_cloud(10);
  const Signature votes = count_votes({cloud.raw(), identity}, planes, {}, simd_level(), 1);
  CHECK(votes.values[8] == 10);
}

}  // namespace
}  // namespace fusionslam::detail
