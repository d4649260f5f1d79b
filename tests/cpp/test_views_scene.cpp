// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Aspects of scenes that Python does not see: SIMD levels, strides, BGR, sections of the bytes.
#include <doctest/doctest.h>

#include <cmath>
#include <random>
#include <vector>

#include "fusionslam/fusionslam.hpp"
#include "levels.hpp"
#include "refused.hpp"
#include "views/dbscan_kernel.hpp"

namespace fusionslam {
namespace {

struct Cloud {
  std::vector<float> points;
  std::vector<std::uint8_t> colors;
};

Cloud random_cloud(std::size_t size) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<float> place(0, 3);
  Cloud cloud;
  for (std::size_t i = 0; i < 3 * size; ++i) {
    cloud.points.push_back(place(generator));
    cloud.colors.push_back(static_cast<std::uint8_t>(generator()));
  }
  return cloud;
}

TEST_CASE("every SIMD level counts the same points, those at the bound among them") {
  std::mt19937 generator(2);
  std::uniform_int_distribution<int> place(0, 4);
  for (const int dimensions : {3, 6})
    for (const std::size_t size : {0U, 1U, 7U, 32U, 61U}) {
      std::vector<double> columns(static_cast<std::size_t>(dimensions) * 64);
      for (double& value : columns) value = place(generator);
      const std::vector<double> query(static_cast<std::size_t>(dimensions), 2.0);
      std::size_t expected = 0;
      for (std::size_t i = 0; i < size; ++i) {
        double squares = 0;
        for (std::size_t d = 0; d < query.size(); ++d)
          squares += (columns[64 * d + i] - 2) * (columns[64 * d + i] - 2);
        expected += squares <= 6 ? 1 : 0;
      }
      for (const SimdLevel level : simd_levels())
        CHECK(detail::count_within(dimensions, level)(columns.data(), 64, size, query.data(), 6) ==
              expected);
    }
}

TEST_CASE("points with gaps and colours in BGR give the same scene") {
  const Cloud cloud = random_cloud(500);
  std::vector<float> wide(4 * 500, -1.0F);
  std::vector<std::uint8_t> bgr(4 * 500);
  for (std::size_t i = 0; i < 500; ++i)
    for (std::size_t d = 0; d < 3; ++d) {
      wide[4 * i + d] = cloud.points[3 * i + d];
      bgr[4 * i + 2 - d] = cloud.colors[3 * i + d];
    }
  const Scene plain = build_scene({cloud.points.data(), 500}, {cloud.colors.data(), 500});
  const Scene strided = build_scene({wide.data(), 500, 4}, {bgr.data() + 2, 500, 4, -1});
  REQUIRE(!plain.objects.empty());
  CHECK(scene_to_bytes(plain) == scene_to_bytes(strided));
}

TEST_CASE("the hull of a tetrahedron has its volume, area and centroid") {
  const std::vector<float> corners{0, 0, 0, 6, 0, 0, 0, 6, 0, 0, 0, 6};
  const Hull hull = convex_hull({corners.data(), 4});
  CHECK(hull.volume == doctest::Approx(36));
  CHECK(hull.area == doctest::Approx(54 + 18 * std::sqrt(3.0)));
  for (const double coordinate : hull.centroid) CHECK(coordinate == doctest::Approx(1.5));
  testing::check_refused<DataError>([] { convex_hull({}); }, "the cloud has 0 points");
}

TEST_CASE("the presets are those of the thesis, of its program and ours") {
  CHECK(scene_preset("paper").center == ObjectCenter::hull);
  CHECK(scene_preset("author").min_size == 1);
  CHECK(scene_preset("robust").color_scale == SceneConfig{}.color_scale);
  CHECK(scene_preset("author").color_scale == doctest::Approx(0.001));
  testing::check_refused<ConfigError>([] { scene_preset("best"); }, "preset is 'best'");
}

TEST_CASE("an interrupt ends a clustering") {
  const Cloud cloud = random_cloud(2000);
  const DbscanConfig config{0.3, 8, 0.001, true};
  const InterruptScope scope([] { return true; });
  CHECK_THROWS_AS(for (int i = 0; i < 1000; ++i)
                      dbscan({cloud.points.data(), 2000}, {cloud.colors.data(), 2000}, config),
                  Interrupted);
}

}  // namespace
}  // namespace fusionslam
