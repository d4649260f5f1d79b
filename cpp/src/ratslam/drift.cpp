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
  while (node != from_) {
    const Link& link = map_.links[reached_.at(node).link];
    const Pose2& end = map_.nodes[node];
    drift.add(Drift::isotropic(link.measure.variance_m, link.measure.variance_rad),
              {pose.x - end.x, pose.y - end.y});
    node = link.source == node ? link.target : link.source;
  }
  return drift;
}

std::optional<Drift> drift_since(const MapArrays& map, std::int64_t node, double limit) {
  DriftSearch search(map, node, limit);
  if (!search.reach(map.current)) return std::nullopt;
  return search.drift(map.current, map.pose());
}

}  // namespace fusionslam::detail
