// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <random>

#include "fusionslam/fusion.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;

constexpr UpAxis all_axes[] = {UpAxis::x,       UpAxis::y,       UpAxis::z,
                               UpAxis::minus_x, UpAxis::minus_y, UpAxis::minus_z};

/// Points in (forward, side, height), and which of them are things on the ground.
struct Scene {
  std::vector<std::array<double, 3>> points;
  std::vector<std::int64_t> things;
  std::mt19937 random{3};

  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  }
  void add(double forward, double side, double height, bool is_thing = false) {
    if (is_thing) things.push_back(static_cast<std::int64_t>(points.size()));
    points.push_back({forward, side, height});
  }
  /// The cloud with `driving` forward and `up` up.
  std::vector<float> cloud(UpAxis up = UpAxis::z, DrivingAxis driving = DrivingAxis::x) const {
    const std::size_t height = static_cast<std::size_t>(up) % 3;
    const auto forward = static_cast<std::size_t>(driving);
    const double sign = static_cast<std::size_t>(up) < 3 ? 1 : -1;
    std::vector<float> result(3 * points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      result[3 * i + forward] = static_cast<float>(points[i][0]);
      result[3 * i + 3 - forward - height] = static_cast<float>(points[i][1]);
      result[3 * i + height] = static_cast<float>(sign * points[i][2]);
    }
    return result;
  }
};

PointsView view(const std::vector<float>& cloud) { return {cloud.data(), cloud.size() / 3}; }

/// A road that rises from 10 m ahead on and leans to the side, with things on it.
double hill(double forward, double side) {
  return 0.02 * side - 1.7 + (forward > 10 ? 0.06 * (forward - 10) : 0);
}

Scene hilly_road() {
  Scene scene;
  for (int i = 0; i < 6000; ++i) {
    const double x = scene.uniform(-30, 30), y = scene.uniform(-15, 15);
    const bool thing = i % 3 == 0;
    scene.add(x, y, hill(x, y) + (thing ? scene.uniform(0.5, 3) : scene.uniform(-0.03, 0.03)),
              thing);
  }
  return scene;
}

TEST_CASE("the road bends and the things on it are kept, whatever is up and ahead") {
  const Scene scene = hilly_road();
  for (const UpAxis up : all_axes)
    for (const DrivingAxis driving : {DrivingAxis::x, DrivingAxis::y, DrivingAxis::z}) {
      if (static_cast<int>(driving) == static_cast<int>(up) % 3) continue;
      INFO("up ", std::string(choice_name(up)), ", ahead ", std::string(choice_name(driving)));
      GroundSegmentsConfig config;
      config.driving = driving;
      const auto cloud = scene.cloud(up, driving);
      const auto ground = remove_ground_segments(view(cloud), up, config);
      CHECK(ground.kept == scene.things);
      REQUIRE(ground.planes.size() == 3);
      REQUIRE(ground.borders.size() == 4);
      CHECK(ground.borders[1] == doctest::Approx(-10).epsilon(0.01));
      const auto& last = ground.planes[2];
      const std::size_t height = static_cast<std::size_t>(up) % 3;
      const double sign = static_cast<std::size_t>(up) < 3 ? 1 : -1;
      CHECK(sign * last[height] > 0.99);
      CHECK(-last[static_cast<std::size_t>(driving)] == doctest::Approx(0.06).epsilon(0.1));
    }
}

TEST_CASE("a single plane does not follow that road") {
  const Scene scene = hilly_road();
  const auto cloud = scene.cloud();
  GroundSegmentsConfig config;
  config.segments = 1;
  CHECK(remove_ground_segments(view(cloud), UpAxis::z, config).kept != scene.things);
}

TEST_CASE("planes are the least squares planes of the points near them") {
  Scene scene;
  for (int i = 0; i < 500; ++i) {
    const double x = scene.uniform(0, 10), y = scene.uniform(-5, 5);
    scene.add(x, y, 0.1 * x - 0.05 * y + 2);
  }
  const auto cloud = scene.cloud();
  GroundSegmentsConfig config;
  config.segments = 2;
  const auto ground = remove_ground_segments(view(cloud), UpAxis::z, config);
  const double length = std::sqrt(0.01 + 0.0025 + 1);
  const std::array<double, 4> expected{-0.1 / length, 0.05 / length, 1 / length, -2 / length};
  for (const auto& plane : ground.planes)
    for (std::size_t i = 0; i < 4; ++i)
      CHECK(plane[i] == doctest::Approx(expected[i]).epsilon(1e-5));
  CHECK(ground.kept.empty());
}

TEST_CASE("an empty segment and one with a few points take their neighbour's plane") {
  Scene scene;
  for (int i = 0; i < 900; ++i)
    scene.add(scene.uniform(0, 10), scene.uniform(-5, 5), 0.01 * (i % 3));
  for (int i = 0; i < 10; ++i) scene.add(scene.uniform(25, 30), scene.uniform(-5, 5), 1.0, true);
  scene.add(30, 0, 0.05);
  const auto cloud = scene.cloud();
  const auto ground = remove_ground_segments(view(cloud));
  CHECK(ground.planes[1] == ground.planes[0]);
  CHECK(ground.planes[2] == ground.planes[0]);
  CHECK(ground.kept == scene.things);
}

TEST_CASE("a wall ahead is no ground: it is cut off where the floor meets it") {
  Scene scene;
  for (int i = 0; i < 2000; ++i) scene.add(scene.uniform(0, 20), scene.uniform(-3, 3), 0);
  for (int i = 0; i < 3000; ++i)
    scene.add(scene.uniform(29.9, 30), scene.uniform(-3, 3), scene.uniform(0.3, 3), true);
  const auto cloud = scene.cloud();
  const auto ground = remove_ground_segments(view(cloud));
  CHECK(ground.kept == scene.things);
  CHECK(ground.planes[2] == ground.planes[1]);
}

TEST_CASE("a table in a segment without floor is no ground, a low step is") {
  for (const double height : {0.15, 0.9}) {
    Scene scene;
    for (int i = 0; i < 2000; ++i) scene.add(scene.uniform(0, 20), scene.uniform(-3, 3), 0);
    for (int i = 0; i < 500; ++i)
      scene.add(scene.uniform(21, 30), scene.uniform(-3, 3), height, height > 0.5);
    const auto cloud = scene.cloud();
    CHECK(remove_ground_segments(view(cloud)).kept == scene.things);
  }
}

TEST_CASE("ghosts below the floor do not take the ground with them") {
  Scene scene;
  for (int i = 0; i < 9; ++i) scene.add(scene.uniform(0, 30), scene.uniform(-3, 3), -4);
  for (int i = 0; i < 3000; ++i) {
    const bool thing = i % 5 == 0;
    scene.add(scene.uniform(0, 30), scene.uniform(-3, 3), thing ? 1 : 0, thing);
  }
  const auto cloud = scene.cloud();
  GroundSegmentsConfig config;
  CHECK(remove_ground_segments(view(cloud), UpAxis::z, config).kept == scene.things);
  config.lowest_share = 0;  // the median of 20 bears nine ghosts by itself
  config.segments = 1;
  CHECK(remove_ground_segments(view(cloud), UpAxis::z, config).kept == scene.things);
}

void check_nothing_found(const std::vector<float>& cloud) {
  const auto ground = remove_ground_segments(view(cloud));
  CHECK(ground.kept.size() == cloud.size() / 3);
  CHECK(ground.planes == std::vector<std::array<double, 4>>(3));
  CHECK(ground.borders.size() == 4);
}

TEST_CASE("where there is no ground all points are kept") {
  Scene wall, line, dot, column;
  for (int i = 0; i < 1000; ++i) {
    wall.add(7, wall.uniform(-5, 5), wall.uniform(0, 4));
    line.add(0.01 * i, 0.02 * i, 0);
    dot.add(3, 2, 1);
    column.add(0, 0, 0.01 * i);
  }
  for (const Scene* scene : {&wall, &line, &dot, &column}) check_nothing_found(scene->cloud());
  check_nothing_found({});
  check_nothing_found({1, 2, 3});
  check_nothing_found(std::vector<float>(3 * 19, 0.0F));  // fewer than `lowest`
}

TEST_CASE("finite coordinates however large end in a finite answer") {
  std::mt19937 random(5);
  std::vector<float> cloud(3000);
  for (float& value : cloud)
    value = std::numeric_limits<float>::max() * (static_cast<float>(random()) / 2147483648.0F - 1);
  const auto ground = remove_ground_segments(view(cloud));
  for (const auto& plane : ground.planes)
    for (const double value : plane) CHECK(std::isfinite(value));
}

TEST_CASE("ground removal by segments is repeatable and does not look at the stride") {
  const Scene scene = hilly_road();
  const auto cloud = scene.cloud();
  std::vector<float> wide;
  for (std::size_t i = 0; i < cloud.size(); i += 3) {
    wide.insert(wide.end(), cloud.begin() + static_cast<std::ptrdiff_t>(i),
                cloud.begin() + static_cast<std::ptrdiff_t>(i + 3));
    wide.push_back(std::nanf(""));
  }
  const auto first = remove_ground_segments(view(cloud));
  const auto second = remove_ground_segments({wide.data(), cloud.size() / 3, 4});
  CHECK(first.planes == second.planes);
  CHECK(first.kept == second.kept);
}

TEST_CASE("ground removal by segments refuses what it cannot do") {
  const std::vector<float> bad{0, 0, 1, 0, std::nanf(""), 1};
  check_refused<DataError>([&] { remove_ground_segments(view(bad)); }, "point 1");
  check_refused<ConfigError>([] { remove_ground_segments({}, UpAxis::minus_x); },
                             "segments.driving is 'x', which is the axis that points up");
  GroundSegmentsConfig config;
  config.segments = 0;
  check_refused<ConfigError>([&] { remove_ground_segments({}, UpAxis::z, config); },
                             "segments.segments is 0");
  config = {};
  config.lowest = 2;
  check_refused<ConfigError>([&] { remove_ground_segments({}, UpAxis::z, config); },
                             "segments.lowest is 2");
}

}  // namespace
}  // namespace fusionslam
