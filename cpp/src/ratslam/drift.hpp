// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "map_arrays.hpp"

namespace fusionslam::detail {

/// Uncertainty of a place relative to another one, along links, in the frame of the map.
using Drift = PoseDrift<2, 1>;

/// Paths of least drift from one node to others (Dijkstra; a radian counts as a metre). Searches no
/// farther than necessary.
class DriftSearch {
 public:
  /// `limit`: nodes whose paths have a larger sum of variances are not reached.
  DriftSearch(const MapArrays& map, std::int64_t from, double limit);

  /// True if there is a path.
  bool reach(std::int64_t node);

  /// Uncertainty of a pose at `node` relative to the start of the search. Errors of heading along
  /// the path count in proportion to the distance from there. `node` must have been reached.
  Drift drift(std::int64_t node, const Pose2& pose) const;

 private:
  struct Reached {
    double sum;
    std::int64_t link;
    bool settled;
  };
  struct Waiting {
    double sum;
    std::int64_t node;
    bool operator<(const Waiting& other) const {
      return sum != other.sum ? sum > other.sum : node > other.node;
    }
  };

  const MapArrays& map_;
  std::int64_t from_;
  double limit_;
  std::unordered_map<std::int64_t, Reached> reached_;
  std::vector<Waiting> waiting_;
};

/// Uncertainty of the robot's place relative to a node, without the motion since its current node;
/// nothing if all paths have a larger sum of variances than `limit`.
std::optional<Drift> drift_since(const MapArrays& map, std::int64_t node, double limit);

}  // namespace fusionslam::detail
