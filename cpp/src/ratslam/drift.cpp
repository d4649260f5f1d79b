// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "drift.hpp"

#include <algorithm>

#include "../detail/interrupt.hpp"

namespace fusionslam::detail {

DriftSearch::DriftSearch(const MapArrays& map, std::int64_t from, double limit)
    : map_(map), from_(from), limit_(limit), waiting_{{0, from}} {
  reached_[from] = {0, -1, false};
}

bool DriftSearch::reach(std::int64_t node) {
  const auto known = reached_.find(node);
  if (known != reached_.end() && known->second.settled) return true;
  while (!waiting_.empty()) {
    check_interrupt();
    std::pop_heap(waiting_.begin(), waiting_.end());
    const Waiting next = waiting_.back();
    waiting_.pop_back();
    if (reached_[next.node].settled) continue;
    reached_[next.node].settled = true;
    map_.around(next.node, [&](std::int64_t number, std::int64_t other) {
      const Measure& measure = map_.links[number].measure;
      const double sum = next.sum + measure.variance_m + measure.variance_rad;
      if (sum > limit_) return;
      const auto [found, is_new] = reached_.try_emplace(other, Reached{sum, number, false});
      if (!is_new && sum >= found->second.sum) return;
      found->second = {sum, number, false};
      waiting_.push_back({sum, other});
      std::push_heap(waiting_.begin(), waiting_.end());
    });
    if (next.node == node) return true;
  }
  return false;
}

Drift DriftSearch::drift(std::int64_t node, const Pose2& pose) const {
  Drift drift;
  // Derivatives of the pose by factors on all distances and on all turns of odometry.
  Drift::Place by_way = Drift::Place::Zero(), by_turn = Drift::Place::Zero();
  double turns = 0;
  while (node != from_) {
    const Link& link = map_.links[reached_.at(node).link];
    const Pose2& end = map_.nodes[node];
    const Drift::Place away(pose.x - end.x, pose.y - end.y);
    drift.add(Drift::isotropic(link.measure.variance_m, link.measure.variance_rad), away);
    const std::int64_t before = link.source == node ? link.target : link.source;
    if (!link.loop) {
      const Pose2& start = map_.nodes[before];
      const Drift::Place way(end.x - start.x, end.y - start.y);
      const double facing = link.measure.facing, first = turn_before_way(link.measure);
      const bool reversed = link.source == node;
      const double turn = reversed ? -facing : facing, early = reversed ? first - facing : first;
      by_way += way;
      by_turn += turn * Drift::Place(-away[1], away[0]) + early * Drift::Place(-way[1], way[0]);
      turns += turn;
    }
    node = before;
  }
  const double way = map_.way_deviation, turn = map_.turn_deviation;
  by_way *= way, by_turn *= turn, turns *= turn;
  drift.place += by_way * by_way.transpose() + by_turn * by_turn.transpose();
  drift.mixed += by_turn * turns;
  drift.turn(0, 0) += turns * turns;
  return drift;
}

std::optional<Drift> drift_since(const MapArrays& map, std::int64_t node, double limit) {
  DriftSearch search(map, node, limit);
  if (!search.reach(map.current)) return std::nullopt;
  return search.drift(map.current, map.pose());
}

}  // namespace fusionslam::detail
