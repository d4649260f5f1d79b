// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The similarity against a version spelt out here, the index against the similarity, and every SIMD
// level against the baseline.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/views/similarity.hpp"
#include "levels.hpp"
#include "refused.hpp"
#include "views/scene_index.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;

SceneObject random_object(std::mt19937& random) {
  std::uniform_real_distribution<double> unit;
  SceneObject object;
  object.center = {8 * unit(random), 6 * unit(random) - 3, 2 * unit(random)};
  object.volume = std::pow(unit(random), 3);
  object.area = 3 * unit(random) + 0.1;
  object.color = {255 * unit(random), 255 * unit(random), 255 * unit(random)};
  object.extents = {2 * unit(random), unit(random), 0.5 * unit(random)};
  object.points = 10 + static_cast<int>(500 * unit(random));
  return object;
}

Scene random_scene(std::mt19937& random, std::size_t count) {
  Scene scene;
  for (std::size_t i = 0; i < count; ++i) scene.objects.push_back(random_object(random));
  return scene;
}

/// The scene as it is seen the next time: nearly the same.
Scene seen_again(Scene scene, std::mt19937& random) {
  std::normal_distribution<double> normal;
  for (auto& object : scene.objects) {
    for (auto& value : object.center) value += 0.2 * normal(random);
    for (auto& value : object.color) value = std::clamp(value + 3 * normal(random), 0.0, 255.0);
    for (auto& value : object.extents) value = std::abs(value + 0.1 * normal(random));
    object.volume = std::abs(object.volume + 0.01 * normal(random));
  }
  return scene;
}

/// Scenes of no to `most` objects, each followed by itself seen again.
std::vector<Scene> many_scenes(std::size_t count, std::size_t most) {
  std::mt19937 random(5);
  std::vector<Scene> scenes;
  for (std::size_t i = 0; i < count; ++i) {
    scenes.push_back(random_scene(random, random() % (most + 1)));
    scenes.push_back(seen_again(scenes.back(), random));
  }
  return scenes;
}

std::vector<SimilarityConfig> configurations() {
  std::vector<SimilarityConfig> result;
  for (const char* preset : {"robust", "paper", "author"})
    for (const auto kind : {ColorDifference::cie76, ColorDifference::ciede2000,
                            ColorDifference::rgb, ColorDifference::author}) {
      result.push_back(similarity_preset(preset));
      result.back().color_difference = kind;
    }
  SimilarityConfig every_term;
  every_term.volume_weight = 0.7;
  every_term.ratio_weight = 0.3;
  result.push_back(every_term);
  every_term.color_weight = every_term.distance_weight = every_term.extent_weight = 0;
  result.push_back(every_term);
  return result;
}

double distance(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/// The formula as the thesis has it, for the terms that it knows.
double thesis_similarity(const SceneObject& a, const SceneObject& b, const SimilarityConfig& c) {
  const auto f = [](double x, double x0, double s) {
    return 1 - 1 / (1 + std::exp(-s * (x - x0)));
  };
  const double color = color_difference(a.color, b.color, c.color_difference);
  const double ratio = std::abs(a.volume / a.area - b.volume / b.area);
  return (c.color_weight * f(color, c.color_x0, c.color_a) +
          c.distance_weight * f(distance(a.center, b.center), c.distance_x0, c.distance_a) +
          c.volume_weight * f(std::abs(a.volume - b.volume), c.volume_x0, c.volume_a) +
          c.ratio_weight * f(ratio, c.ratio_x0, c.ratio_a)) /
         (c.color_weight + c.distance_weight + c.volume_weight + c.ratio_weight);
}

TEST_CASE("objects are as alike as the formula of the thesis says") {
  std::mt19937 random(3);
  for (const char* preset : {"paper", "author"}) {
    const SimilarityConfig config = similarity_preset(preset);
    for (int i = 0; i < 200; ++i) {
      const SceneObject a = random_object(random);
      const SceneObject b = seen_again({{a}}, random).objects[0];
      CHECK(object_similarity(a, b, config) ==
            doctest::Approx(thesis_similarity(a, b, config)).epsilon(1e-12));
    }
  }
}

TEST_CASE("a scene is 0.8614 like itself with the published parameters, and 1 with ours") {
  std::mt19937 random(4);
  for (std::size_t count = 1; count < 6; ++count) {
    const Scene scene = random_scene(random, count);
    CHECK(scene_similarity(scene, scene, similarity_preset("author")) ==
          doctest::Approx(0.8614).epsilon(1e-4));
    CHECK(scene_similarity(scene, scene) == doctest::Approx(1).epsilon(1e-14));
  }
}

TEST_CASE("the robust preset is symmetric, the author's is not") {
  std::mt19937 random(6);
  const Scene a = random_scene(random, 5), b = random_scene(random, 3);
  CHECK(scene_similarity(a, b) == doctest::Approx(scene_similarity(b, a)).epsilon(1e-14));
  const SimilarityConfig author = similarity_preset("author");
  CHECK(std::abs(scene_similarity(a, b, author) - scene_similarity(b, a, author)) > 1e-3);
}

TEST_CASE("large objects count more, in the number of their points") {
  std::mt19937 random(7);
  const SimilarityConfig config = similarity_preset("paper");
  Scene current = random_scene(random, 2);
  current.objects[0].points = 30;
  current.objects[1].points = 10;
  const Scene stored{{current.objects[0]}};
  const double same = object_similarity(current.objects[0], stored.objects[0], config);
  const double other = object_similarity(current.objects[1], stored.objects[0], config);
  CHECK(scene_similarity(current, stored, config) ==
        doctest::Approx((3 * same + other) / 4).epsilon(1e-12));
}

TEST_CASE("an empty scene is like another empty one only") {
  std::mt19937 random(8);
  const Scene empty, scene = random_scene(random, 3);
  for (const SimilarityConfig& config : configurations()) {
    SceneIndex index(config);
    index.add(empty);
    index.add(scene);
    CHECK(scene_similarity(empty, empty, config) == 1);
    CHECK(scene_similarity(empty, scene, config) == 0);
    CHECK(scene_similarity(scene, empty, config) == 0);
    CHECK(index.similarities(empty) == std::vector<double>{1, 0});
    CHECK(index.similarities(scene)[0] == 0);
  }
}

TEST_CASE("an index gives what the similarity of two scenes gives") {
  const auto scenes = many_scenes(60, 12);
  for (const SimilarityConfig& config : configurations()) {
    SceneIndex index(config);
    for (std::size_t i = 0; i < scenes.size(); ++i) CHECK(index.add(scenes[i]) == i);
    for (std::size_t i = 0; i < scenes.size(); i += 7) {
      const auto found = index.similarities(scenes[i]);
      for (std::size_t j = 0; j < scenes.size(); ++j)
        CHECK(std::abs(found[j] - scene_similarity(scenes[i], scenes[j], config)) < 1e-6);
    }
  }
}

TEST_CASE("a scene of more objects than a block holds is compared like any other") {
  std::mt19937 random(9);
  const Scene large = random_scene(random, 700), small = random_scene(random, 3);
  SceneIndex index;
  for (const Scene& scene : {small, large, small}) index.add(scene);
  for (const Scene& current : {small, large}) {
    const auto found = index.similarities(current);
    CHECK(std::abs(found[0] - scene_similarity(current, small)) < 1e-6);
    CHECK(std::abs(found[1] - scene_similarity(current, large)) < 1e-6);
    CHECK(found[2] == found[0]);
  }
}

TEST_CASE("every SIMD level and any number of threads give the same bits") {
  const auto scenes = many_scenes(700, 6);
  for (const SimilarityConfig& config : configurations()) {
    SceneIndex index(config);
    detail::StoredScenes stored(config);
    for (const Scene& scene : scenes) {
      index.add(scene);
      stored.put(stored.size(), detail::compared_objects(scene, config));
    }
    const auto alone = index.similarities(scenes[4]);
    CHECK(index.similarities(scenes[4], 3) == alone);
    const auto current = detail::compared_objects(scenes[4], config);
    for (const SimdLevel level : simd_levels()) {
      std::vector<double> found(scenes.size());
      detail::compare_scenes(stored, current, 0, scenes.size(), level, found.data());
      CHECK(found == alone);
    }
  }
}

TEST_CASE("replacing and removing leave what a new index would hold") {
  const auto scenes = many_scenes(20, 5);
  SceneIndex changed;
  for (const Scene& scene : scenes) changed.add(scene);
  std::vector<Scene> left = scenes;
  std::mt19937 random(10);
  for (int step = 0; step < 60 && left.size() > 1; ++step) {
    const std::size_t number = random() % left.size();
    if (step % 3 == 0) {
      changed.remove(number);
      left.erase(left.begin() + static_cast<std::ptrdiff_t>(number));
    } else {
      left[number] = random_scene(random, random() % 7);
      changed.replace(number, left[number]);
    }
    SceneIndex fresh;
    for (const Scene& scene : left) fresh.add(scene);
    CHECK(changed.size() == left.size());
    CHECK(changed.similarities(scenes[0]) == fresh.similarities(scenes[0]));
  }
  check_refused<ConfigError>([&] { changed.remove(changed.size()); }, "is not stored");
}

TEST_CASE("weights that are all 0 are refused") {
  SimilarityConfig config;
  config.color_weight = config.distance_weight = config.extent_weight = 0;
  const Scene scene;
  check_refused<ConfigError>([&] { scene_similarity(scene, scene, config); }, "all 0");
  check_refused<ConfigError>([&] { SceneIndex index(config); }, "color_weight");
  config.volume_weight = -1;
  check_refused<ConfigError>([&] { SceneIndex index(config); }, "volume_weight");
  check_refused<ConfigError>([] { similarity_preset("best"); }, "robust");
}

TEST_CASE("objects that are not finite, colourless or without points are refused") {
  std::mt19937 random(11);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Scene good = random_scene(random, 3);
  std::vector<Scene> bad(6, good);
  bad[0].objects[1].center[2] = nan;
  bad[1].objects[1].volume = nan;
  bad[2].objects[1].extents[0] = std::numeric_limits<double>::infinity();
  bad[3].objects[1].color[1] = nan;
  bad[4].objects[1].color[0] = 256;
  bad[5].objects[1].points = 0;
  SceneIndex index;
  index.add(good);
  for (const Scene& scene : bad) {
    check_refused<DataError>([&] { scene_similarity(good, scene); }, "object 1");
    check_refused<DataError>([&] { index.add(scene); }, "object 1");
    check_refused<DataError>([&] { index.replace(0, scene); }, "object 1");
    check_refused<DataError>([&] { index.similarities(scene); }, "object 1");
  }
  CHECK(index.size() == 1);
  CHECK(index.similarities(good)[0] == doctest::Approx(1).epsilon(1e-6));
}

TEST_CASE("flat objects and points, whose hull has no area, are compared, too") {
  SceneObject point;
  point.points = 10;
  CHECK(object_similarity(point, point) == doctest::Approx(1).epsilon(1e-14));
  SceneIndex index;
  index.add({{point}});
  CHECK(index.similarities({{point}})[0] == doctest::Approx(1).epsilon(1e-6));
}

}  // namespace
}  // namespace fusionslam
