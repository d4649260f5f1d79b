// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Threads that share objects as their classes allow, and calls with threads of their own, for
// ThreadSanitizer (scripts/sanitize.sh) and for equal results.
#include <doctest/doctest.h>

#include <array>
#include <functional>
#include <latch>
#include <thread>
#include <vector>

#include "clouds.hpp"
#include "fusionslam/fusionslam.hpp"
#include "fusionslam/ratslam/experience_map.hpp"
#include "fusionslam/ratslam/pose_cells.hpp"
#include "fusionslam/views/alignment.hpp"
#include "fusionslam/views/similarity.hpp"

namespace fusionslam {
namespace {

constexpr int threads = 4;

/// What `work` returns on each of several threads that begin together.
template <class Work>
auto results_of_threads(Work&& work) {
  std::array<decltype(work()), threads> results;
  std::latch begin(threads);
  std::vector<std::jthread> running;
  for (auto& result : results)
    running.emplace_back([&] {
      begin.arrive_and_wait();
      result = work();
    });
  running.clear();
  return results;
}

/// Calls `work` alone and on several threads at once, and compares what it returns.
template <class Work>
void check_shared(Work&& work) {
  const auto alone = work();
  for (const auto& result : results_of_threads(work)) CHECK(result == alone);
}

std::vector<double> numbers(const std::vector<Match>& matches) {
  std::vector<double> values;
  for (const auto& [index, distance] : matches) {
    values.push_back(static_cast<double>(index));
    values.push_back(static_cast<double>(distance));
  }
  return values;
}

std::vector<double> numbers(const std::vector<AlignedScene>& scenes) {
  std::vector<double> values;
  for (const auto& [number, alignment] : scenes) {
    values.push_back(static_cast<double>(number));
    values.insert(values.end(), {alignment.x, alignment.y, alignment.yaw, alignment.probability});
  }
  return values;
}

std::vector<Scene> scenes() {
  std::vector<Scene> all;
  for (unsigned seed = 0; seed < 6; ++seed) {
    const auto cloud = testing::random_cloud(800, seed);
    all.push_back(build_scene(cloud.points_view(), cloud.colors_view(), scene_preset("paper")));
    all.back().image = build_scene(cloud.points_view(), cloud.colors_view()).image;
  }
  return all;
}

ExperienceMap driven_map() {
  ExperienceMap map;
  map.apply({ActionKind::create_node});
  for (std::int64_t node = 0; node < 60; ++node) {
    map.on_odometry(0.5, 0.2, 1);
    map.apply({ActionKind::create_node, node, node + 1});
  }
  map.apply({ActionKind::create_edge, 60, 29});
  return map;
}

TEST_CASE("threads may query one descriptor index") {
  DescriptorIndex index(8);
  const auto cloud = testing::random_cloud(800);
  for (std::size_t i = 0; i + 8 <= cloud.points.size(); i += 8)
    index.add(std::span(cloud.points).subspan(i, 8));
  const auto query = std::span(cloud.points).first(8);
  check_shared([&] { return numbers(index.query(query, 5)); });
  check_shared([&] { return index.to_bytes(); });
}

TEST_CASE("threads may query one scene index and one alignment index") {
  SceneIndex similar;
  AlignmentIndex aligned;
  const auto all = scenes();
  for (const Scene& scene : all) {
    similar.add(scene);
    aligned.add(scene);
  }
  for (const int more : {1, 2}) {
    check_shared([&] { return similar.similarities(all[2], more); });
    check_shared([&] { return numbers(aligned.query(all[2], more)); });
  }
  check_shared([&] { return similar.state().values; });
}

TEST_CASE("threads may read one map and one sheet of pose cells") {
  const ExperienceMap map = driven_map();
  check_shared([&] { return map.state().nodes; });
  check_shared([&] { return std::vector{map.pose().x, map.offset().x, map.node(7).x}; });
  PoseSheet sheet(11);
  sheet.inject({2, 3, 4}, 0.3);
  sheet.settle(1e-5);
  check_shared([&] { return std::vector{sheet.decode().x, sheet.decode().th}; });
}

TEST_CASE("threads may each change a map and a sheet of their own") {
  check_shared([] {
    ExperienceMap map = driven_map();
    map.check({ActionKind::create_edge, map.current(), 5});
    map.relax(true);
    return map.state().nodes;
  });
  check_shared([] {
    PoseSheet sheet(11);
    const std::vector<double> ways(PoseSheet::headings, 0.3);
    for (int step = 0; step < 5; ++step) {
      sheet.move(ways, ways, 0.2);
      sheet.settle(1e-5);
    }
    return std::vector(sheet.activity().begin(), sheet.activity().end());
  });
}

TEST_CASE("functions may be called at once, also with threads of their own") {
  const auto cloud = testing::random_cloud(1500);
  const auto points = cloud.points_view();
  const auto colors = cloud.colors_view();
  for (const int more : {1, 3}) {
    check_shared([&] { return m2dp(points, {}, more); });
    check_shared([&] { return cm2dp(points, colors, ColorSpace::lab, {}, more); });
    check_shared([&] { return cshot(points, colors, 1.5, more); });
    check_shared([&] { return estimate_normals(points, 1.0, more).normals; });
    check_shared([&] { return nearest_causal(cloud.points, 3, 5, 2, more).distances; });
  }
  check_shared([&] { return voxel_downsample(points, colors, 0.5).points; });
  check_shared([&] { return remove_ground_plane(points, UpAxis::z).kept; });
  check_shared([&] { return remove_ground_segments(points, UpAxis::z).kept; });
  check_shared([&] { return dbscan(points, colors, {0.5, 5}); });
  check_shared([&] { return convex_hull(points).volume; });
}

TEST_CASE("images may be rectified and matched at once") {
  std::vector<std::uint8_t> pixels(96 * 64);
  for (std::size_t i = 0; i < pixels.size(); ++i)
    pixels[i] = static_cast<std::uint8_t>(i * i % 251);
  const ImageView image{pixels.data(), 96, 64, 1, 96};
  CameraCalibration calibration{96, 64, {50, 0, 48, 0, 50, 32, 0, 0, 1}, {}, DistortionModel::none};
  calibration.projection = {45, 0, 48, 0, 0, 46, 32, 0, 0, 0, 1, 0};
  check_shared([&] { return rectify_image(image, calibration).pixels; });
  check_shared([&] { return demosaic(image, BayerPattern::rggb).pixels; });
  check_shared([&] { return stereo_disparity(image, image, stereo_preset("sgbm")); });
}

}  // namespace
}  // namespace fusionslam
