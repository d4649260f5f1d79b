// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Alignment through the C++ interface; poses and images are tested from Python.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/views/alignment.hpp"
#include "refused.hpp"
#include "views/alignment.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;

/// Distance of a wall at -half or half along a direction's component.
double until(double half, double place, double direction) {
  if (direction == 0) return std::numeric_limits<double>::infinity();
  return ((direction > 0 ? half : -half) - place) / direction;
}

/// A room of 8 x 6 m with coloured walls, as a robot at x, y, yaw sees it all round.
Scene room(double x, double y, double yaw) {
  std::vector<float> points;
  std::vector<std::uint8_t> colors;
  for (int column = 0; column < 360; ++column)
    for (int row = -3; row < 12; ++row) {
      const double azimuth = column * std::numbers::pi / 180;
      const double c = std::cos(azimuth + yaw), s = std::sin(azimuth + yaw);
      const double to_side = until(4, x, c), to_end = until(3, y, s);
      const double level = std::min(to_side, to_end);
      const double height = 0.17 + level * std::tan(row * std::numbers::pi / 90);
      for (const double value : {level * std::cos(azimuth), level * std::sin(azimuth), height})
        points.push_back(static_cast<float>(value));
      // Stripes along each wall, so that no two walls look alike.
      const double along = to_side < to_end ? y + level * s : x + level * c;
      const int shade = static_cast<int>(std::floor(2 * along)) & 3;
      colors.push_back(static_cast<std::uint8_t>(to_side < to_end ? 40 * shade + 40 : 200));
      colors.push_back(static_cast<std::uint8_t>(c > 0 ? 30 * shade : 240 - 30 * shade));
      colors.push_back(static_cast<std::uint8_t>(s > 0 ? 180 : 20));
    }
  const std::size_t size = points.size() / 3;
  return build_scene({points.data(), size}, {colors.data(), size});
}

bool same(const Alignment& a, const Alignment& b) {
  return a.x == b.x && a.y == b.y && a.yaw == b.yaw && a.probability == b.probability &&
         a.evidence.values == b.evidence.values;
}

TEST_CASE("a scene lies over itself at the origin") {
  const Scene scene = room(0.4, -0.3, 0.7);
  const Alignment found = align_scenes(scene, scene);
  CHECK(std::fabs(found.x) < 1e-3);
  CHECK(std::fabs(found.y) < 1e-3);
  CHECK(std::fabs(found.yaw) < 1e-3);
  CHECK(found.probability > 0.96);
}

TEST_CASE("a scene seen from aside lies where it was seen from") {
  const Alignment found = align_scenes(room(0.2, 0, 0.1), room(0, 0, 0));
  CHECK(found.x == doctest::Approx(0.2).epsilon(0.05));
  CHECK(std::fabs(found.y) < 0.01);
  CHECK(found.yaw == doctest::Approx(0.1).epsilon(0.05));
}

TEST_CASE("an index finds what pairs give, whatever the threads") {
  AlignmentIndex index;
  for (int i = 0; i < 6; ++i) index.add(room(0.4 * i - 1, 0.1 * i, 0.3 * i));
  const Scene current = room(-0.1, 0.2, 0.5);
  const auto one = index.query(current), four = index.query(current, 4);
  REQUIRE(one.size() == 6);
  for (std::size_t i = 0; i < one.size(); ++i) {
    CHECK(one[i].number == four[i].number);
    CHECK(same(one[i].alignment, four[i].alignment));
    const int number = static_cast<int>(one[i].number);
    CHECK(same(one[i].alignment,
               align_scenes(current, room(0.4 * number - 1, 0.1 * number, 0.3 * number))));
  }
}

TEST_CASE("evidence beyond what was fitted to counts no more") {
  AlignmentEvidence evidence = align_scenes(room(0, 0, 0), room(0, 0, 0)).evidence;
  double before = 0;
  for (const double thumbnail : {1e2, 1e4, 1e8}) {
    evidence.values[9] = thumbnail;
    const double probability = detail::probability_of(evidence);
    CHECK((before == 0 || probability == before));
    before = probability;
  }
}

TEST_CASE("scenes without images, bad values and numbers that are not there") {
  const Scene scene = room(0, 0, 0);
  CHECK(align_scenes(scene, Scene{}).probability == 0);
  CHECK(align_scenes(Scene{}, scene).probability == 0);
  AlignmentConfig config;
  config.candidates = 0;
  check_refused<ConfigError>([&] { align_scenes(scene, scene, config); }, "candidates is 0");
  check_refused<ConfigError>([&] { AlignmentIndex index(config); }, "candidates is 0");
  AlignmentIndex index;
  check_refused<ConfigError>([&] { index.remove(0); }, "there is no scene 0 among 0");
}

}  // namespace
}  // namespace fusionslam
