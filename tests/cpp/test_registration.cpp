// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <limits>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/registration.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;

PointsView view(const std::vector<float>& points) { return {points.data(), points.size() / 3}; }

/// A wall 10 m ahead, with a hole of 6 degrees to each side straight ahead.
std::vector<float> wall() {
  std::vector<float> points;
  for (int i = -90; i <= 90; ++i)
    for (int j = -40; j <= 40; ++j) {
      if (std::abs(i) < 12 && std::abs(j) < 12) continue;
      constexpr float half_degree = 3.14159265F / 360;
      const float azimuth = static_cast<float>(i) * half_degree;
      const float elevation = static_cast<float>(j) * half_degree;
      points.insert(points.end(),
                    {10, 10 * std::tan(azimuth), 10 * std::tan(elevation) / std::cos(azimuth)});
    }
  return points;
}

TEST_CASE("each point is counted by what the other sensor saw") {
  const std::vector<float> seen = wall();
  const NearestRanges ranges = nearest_ranges(view(seen), 2);
  CHECK(ranges.rows == 90);
  CHECK(ranges.columns == 180);
  const auto counts = [&](const std::vector<float>& point) {
    const OverlapCounts c = count_overlap(view(point), view(seen), ranges, identity_transform, 0.5);
    return std::vector<std::size_t>{c.agreeing, c.before, c.open, c.behind, c.outside};
  };
  using Counts = std::vector<std::size_t>;
  CHECK(counts({10, 5, 0}) == Counts{1, 0, 0, 0, 0});
  CHECK(counts({5, 2.5F, 0}) == Counts{0, 1, 0, 0, 0});
  CHECK(counts({5, 0, 0}) == Counts{0, 0, 1, 0, 0});
  CHECK(counts({12, 6, 0}) == Counts{0, 0, 0, 1, 0});
  CHECK(counts({-5, 0, 0}) == Counts{0, 0, 0, 0, 1});
}

TEST_CASE("what any view of a joined cloud saw counts, and each point once") {
  const std::vector<float> seen = wall();
  Transform further_back =
      identity_transform;  // view_from_cloud: 10 m behind, the wall is 20 m off
  further_back[3] = 10;
  std::vector<float> moved = seen;
  for (std::size_t i = 0; i < moved.size(); i += 3) moved[i] += 10;
  const std::vector<SensorView> views{{nearest_ranges(view(seen), 2), identity_transform},
                                      {nearest_ranges(view(moved), 2), further_back}};
  const auto counts = [&](const std::vector<float>& point) {
    const OverlapCounts c = count_overlap(view(point), view(seen), views, identity_transform, 0.5);
    return std::vector<std::size_t>{c.agreeing, c.before, c.open, c.behind, c.outside};
  };
  using Counts = std::vector<std::size_t>;
  CHECK(counts({10, 5, 0}) == Counts{1, 0, 0, 0, 0});
  CHECK(counts({-5, 1.5F, 0}) ==
        Counts{0, 1, 0, 0, 0});  // out of the first view, free in the second
  CHECK(counts({12, 6, 0}) == Counts{0, 0, 0, 1, 0});
  CHECK(counts({-15, 0, 0}) == Counts{0, 0, 0, 0, 1});
  check_refused<ShapeError>(
      [&] {
        count_overlap(view(seen), view(seen), std::vector<SensorView>{}, identity_transform, 0.5);
      },
      "views");
}

TEST_CASE("points are moved into the other sensor's frame") {
  const std::vector<float> seen = wall(), point{0, 5, 0};
  Transform ahead = identity_transform;
  ahead[3] = 10;
  const NearestRanges ranges = nearest_ranges(view(seen), 2);
  CHECK(count_overlap(view(point), view(seen), ranges, ahead, 0.5).agreeing == 1);
}

TEST_CASE("an overlap of bad input is refused") {
  const std::vector<float> seen = wall();
  const NearestRanges whole = nearest_ranges(view(seen), 2);
  const auto count = [&](const NearestRanges& ranges, const Transform& motion, double distance) {
    return
        [&, motion, distance] { count_overlap(view(seen), view(seen), ranges, motion, distance); };
  };
  for (const double step : {0.05, 31.0})
    check_refused<ConfigError>([&] { nearest_ranges(view(seen), step); }, "0.1 to 30");
  for (const double distance : {0.0, 101.0})
    check_refused<ConfigError>(count(whole, identity_transform, distance), "up to 100 m");
  NearestRanges short_one = whole;
  short_one.ranges.pop_back();
  check_refused<ShapeError>(count(short_one, identity_transform, 0.5), "90 x 180 cells");
  for (const float range : {-1.0F, std::numeric_limits<float>::infinity()}) {
    NearestRanges broken = whole;
    broken.ranges[7] = range;
    check_refused<DataError>(count(broken, identity_transform, 0.5), "range 7 is");
  }
  for (const int entry : {0, 15}) {
    Transform stretched = identity_transform;
    stretched[static_cast<std::size_t>(entry)] = 2;
    check_refused<DataError>(count(whole, stretched, 0.5), "no rigid motion");
  }
}

}  // namespace
}  // namespace fusionslam
