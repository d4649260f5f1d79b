// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Histograms of a cloud, of its regions and about its keypoints, by hand.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "clouds.hpp"
#include "descriptors/smooth_regions.hpp"
#include "fusionslam/descriptors.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;
using testing::Cloud;

TEST_CASE("a VFH of two points is that by hand") {
  // u is the normal that is nearer to the line: of the first point the centre's, (0, 0, 1), of the
  // second its own, from which the centre's is atan(0.6 / 0.8) = 0.6435 away; the cosine of the
  // line is then -0.6. Bins: 45 (value + pi) / (2 pi) = 22.5, 27.1 and 18.2.
  const detail::OrientedPoints cloud{{1, 0, 0, 2, 0, 0}, {0, 0, 1, 0.6F, 0, 0.8F}, {0, 0}, {}};
  const auto found = detail::vfh_histogram(cloud, {{0, 0, 0}, {0, 0, 1}});
  std::array<float, detail::vfh_size> expected{};
  for (const std::size_t bin : {22UL, 27UL}) expected[bin] += 100;
  expected[45 + 22] += 200;
  for (const std::size_t bin : {22UL, 18UL}) expected[90 + bin] += 100;
  for (const std::size_t bin : {22UL, 44UL}) expected[135 + bin] += 100;
  expected[180 + 64] += 100;  // the centre is the origin, so that there is no direction to it
  CHECK(found == expected);
}

TEST_CASE("smooth regions are the faces of a box, the largest first") {
  Cloud box;
  const auto add = [&](double x, double y, double z) {
    for (const double value : {x, y, z}) box.points.push_back(static_cast<float>(value));
  };
  for (double a = 0.05; a < 4; a += 0.1)
    for (double b = 0.05; b < 3; b += 0.1) {
      add(a, b, 5);
      if (a < 2) add(8, b, a);
    }
  const auto cloud = detail::oriented_points(box.points_view(), {}, 0.1, 0, 1, "test");
  const auto found = detail::smooth_regions(cloud, {0.1, 0, 50, 0.03, 0.125}, 1, "test");
  REQUIRE(found.regions.size() == 2);
  CHECK(found.regions[0].size() == 1200);
  CHECK(found.regions[1].size() == 600);
  const auto center = detail::region_center(found.points, found.regions[0]);
  CHECK(center.point[0] == doctest::Approx(2));
  CHECK(center.point[1] == doctest::Approx(1.5));
  CHECK(center.normal[2] == doctest::Approx(-1));
  check_refused<DataError>(
      [&] { detail::smooth_regions(cloud, {0.1, 0, 1201, 0.03, 0.125}, 1, "test"); },
      "no smooth region of 1201 points");
}

TEST_CASE("the ESF of one triangle has its angles, sides and area") {
  // Sides 3, 4, 5, of which the longest is in the last bin; angles of 90, 53.1 and 36.9 degrees in
  // 63 bins of a right angle. All lines are off the surface, which is three voxels.
  const std::vector<float> triangle{0, 0, 1, 3, 0, 1, 0, 4, 1};
  const auto found = esf({triangle.data(), 3});
  const auto bins = [&](std::size_t histogram) {
    std::vector<int> filled;
    for (int i = 0; i < 64; ++i)
      if (found[64 * histogram + static_cast<std::size_t>(i)] > 0) filled.push_back(i);
    return filled;
  };
  CHECK(bins(1) == std::vector<int>{26, 37, 63});
  CHECK(bins(4) == std::vector<int>{63});
  CHECK(bins(7) == std::vector<int>{38, 50, 63});
  for (const std::size_t histogram : {0, 2, 3, 5, 6, 8, 9}) CHECK(bins(histogram).empty());
  // A line weighs four times as much as an area.
  CHECK(found[64 * 7 + 38] == doctest::Approx(4 * found[64 * 4 + 63]));
  CHECK(found[64 * 7 + 38] == found[64 * 7 + 63]);
}

TEST_CASE("GFH of one point has equal amplitudes, and of two opposite ones only even periods") {
  const GfhConfig config{8, 2, 1, 10, -1, 1};
  const std::vector<float> points{1, 0.1F, 0, -1, -0.1F, 0};
  const auto one = gfh({points.data(), 1}, config), two = gfh({points.data(), 2}, config);
  REQUIRE(one.size() == 10);
  for (std::size_t f = 0; f < 5; ++f) {
    CHECK(one[f] == doctest::Approx(1 / std::sqrt(5.0)));
    CHECK(two[f] == doctest::Approx(f % 2 ? 0 : 1 / std::sqrt(3.0)).epsilon(1e-6));
    CHECK(one[5 + f] == 0);
  }
}

TEST_CASE("a cloud that cannot be described is refused with what is needed") {
  const std::vector<float> line{0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0};
  const std::vector<float> nan{0, 0, std::nanf(""), 1, 0, 0, 2, 0, 0, 3, 0, 0};
  const std::vector<std::uint8_t> colors(12, 100);
  const auto refuse = [](const char* words, const PointsView& points, const ColorsView& colored) {
    check_refused<DataError>([&] { vfh(points); }, words);
    check_refused<DataError>([&] { cvfh(points); }, words);
    check_refused<DataError>([&] { our_cvfh(points); }, words);
    check_refused<DataError>([&] { esf(points); }, words);
    check_refused<DataError>([&] { gasd_color(points, colored); }, words);
    check_refused<DataError>([&] { gestalt(points); }, words);
    check_refused<DataError>([&] { gfh(points); }, words);
    check_refused<DataError>([&] { cospair(points, colored); }, words);
  };
  refuse("needs at least", {nullptr, 0}, {nullptr, 0});
  refuse("point 0 is not finite", {nan.data(), 4}, {colors.data(), 4});
  check_refused<DataError>([&] { vfh({line.data(), 4}); }, "3 points with a normal");
  check_refused<DataError>([&] { esf({line.data(), 4}); }, "triangles");
  check_refused<DataError>([&] { gestalt({line.data(), 4}); }, "none has 30");
  check_refused<ShapeError>([&] { gasd_color({line.data(), 4}, {colors.data(), 3}); },
                            "colors has 3 rows");
  check_refused<ShapeError>([&] { cospair({line.data(), 4}, {colors.data(), 3}); },
                            "colors has 3 rows");
  check_refused<ConfigError>([&] { gfh({line.data(), 4}, {8, 2, 1, 10, 1, 1}); }, "gfh.top");
}

}  // namespace
}  // namespace fusionslam
