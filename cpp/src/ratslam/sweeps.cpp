// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <vector>

#include "../detail/interrupt.hpp"
#include "map_arrays.hpp"
#include "sweeps_kernel.hpp"

namespace fusionslam::detail {
namespace {

std::vector<SweptNode> copy_nodes(const MapArrays& map) {
  std::vector<SweptNode> nodes;
  nodes.reserve(map.nodes.size());
  for (const Pose2& node : map.nodes)
    nodes.push_back({node.x, node.y, node.heading, std::cos(node.heading), std::sin(node.heading)});
  return nodes;
}

/// By source, and each source's in the order of their making.
std::vector<SweptLink> copy_links(const MapArrays& map) {
  std::vector<SweptLink> links;
  links.reserve(map.links.size());
  for (const std::int64_t first : map.out.first)
    for (auto link = first; link >= 0; link = map.out.next[link]) {
      const Pose2 way = map.links[link].measure.pose();
      links.push_back({map.links[link].source, map.links[link].target, way.x, way.y, way.heading});
    }
  return links;
}

double farthest_move(const MapArrays& map, const std::vector<SweptNode>& nodes) {
  double farthest = 0;
  for (std::size_t i = 0; i < nodes.size(); ++i)
    farthest =
        std::max(farthest, std::hypot(nodes[i].x - map.nodes[i].x, nodes[i].y - map.nodes[i].y));
  return farthest;
}

}  // namespace

Relaxation relax_by_sweeps(MapArrays& map) {
  auto nodes = copy_nodes(map);
  const auto links = copy_links(map);
  SweptSquares squares;
  for (int i = 0; i < map.config.loops; ++i) {
    check_interrupt();
    squares = sweep(nodes.data(), links.data(), links.size(), map.config.correction);
  }
  Relaxation done;
  done.step_m = farthest_move(map, nodes);
  done.sweeps = map.config.loops;
  done.nodes = map.size();
  done.settled = done.step_m <= map.config.tolerance;
  if (!links.empty()) {
    done.residual_m = std::sqrt(squares.place / static_cast<double>(links.size()));
    done.residual_rad = std::sqrt(squares.rotation / static_cast<double>(links.size()));
  }
  for (std::size_t i = 0; i < nodes.size(); ++i)
    map.nodes[i] = {nodes[i].x, nodes[i].y, wrap_angle(nodes[i].heading)};
  return done;
}

}  // namespace fusionslam::detail
