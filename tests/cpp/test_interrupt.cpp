// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Calls whose length depends on the data can be interrupted and leave objects as they were.
#include <doctest/doctest.h>

#include <thread>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/fusionslam.hpp"
#include "fusionslam/interrupt.hpp"
#include "fusionslam/ratslam/experience_map.hpp"
#include "fusionslam/ratslam/pose_cells.hpp"
#include "fusionslam/views/similarity.hpp"

namespace fusionslam {
namespace {

/// True if a call that is interrupted at the first question ends with Interrupted. Threads ask only
/// every 20 ms, so each call gets a thread of its own.
template <class Call>
bool is_interrupted(Call&& call) {
  bool interrupted = false;
  std::jthread([&] {
    const InterruptScope scope([] { return true; });
    try {
      call();
    } catch (const Interrupted&) {
      interrupted = true;
    }
  }).join();
  return interrupted;
}

ExperienceMap driven_map() {
  ExperienceMap map;
  map.apply({ActionKind::create_node});
  for (std::int64_t node = 0; node < 30; ++node) {
    map.on_odometry(0.5, 0.2, 1);
    map.apply({ActionKind::create_node, node, node + 1});
  }
  return map;
}

bool same(const MapState& a, const MapState& b) {
  return a.nodes == b.nodes && a.ends == b.ends && a.links == b.links && a.loops == b.loops &&
         a.robot == b.robot && a.counts == b.counts && a.due == b.due &&
         a.pending_ends == b.pending_ends && a.pending == b.pending;
}

TEST_CASE("checking and making a loop can be interrupted and then change nothing") {
  ExperienceMap map = driven_map();
  const MapState before = map.state();
  const MapAction loop{ActionKind::create_edge, 30, 3};
  CHECK(is_interrupted([&] { map.check(loop); }));
  CHECK(is_interrupted([&] { map.apply(loop); }));
  CHECK(same(map.state(), before));
  map.apply(loop);
  CHECK(is_interrupted([&] { map.relax(); }));
  CHECK(is_interrupted([&] { map.relax(true); }));
  CHECK(map.relax(true).settled);
}

TEST_CASE("steps of the pose cells can be interrupted and then change nothing") {
  PoseSheet sheet(11);
  const std::vector<double> before(sheet.activity().begin(), sheet.activity().end());
  const std::vector<double> ways(PoseSheet::headings, 0.3);
  CHECK(is_interrupted([&] { sheet.settle(1e-5); }));
  CHECK(is_interrupted([&] { sheet.move(ways, ways, 0.2); }));
  CHECK(std::vector(sheet.activity().begin(), sheet.activity().end()) == before);
}

TEST_CASE("comparing scenes can be interrupted") {
  Scene scene;
  scene.objects.resize(3);
  for (SceneObject& object : scene.objects) object.points = 10;
  SceneIndex index;
  index.add(scene);
  CHECK(is_interrupted([&] { scene_similarity(scene, scene); }));
  CHECK(is_interrupted([&] { index.similarities(scene); }));
}

}  // namespace
}  // namespace fusionslam
