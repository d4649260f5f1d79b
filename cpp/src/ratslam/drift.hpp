// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "map_arrays.hpp"

namespace fusionslam::detail {

/// How uncertain a place is against another one, along links.
struct Drift {
  double xx = 0, xy = 0, yy = 0;  ///< m^2, in the frame of the map
  double rotation = 0;            ///< rad^2

  /// Variance in a direction; of no direction, the largest.
  double along(double x, double y) const;
  double largest() const;
};

/// Ways of least drift from one node to others (Dijkstra; a radian counts as a metre). Searches no
/// farther than it has to.
class DriftSearch {
 public:
  /// `limit`: no node whose way has a larger sum of variances is found.
  DriftSearch(const MapArrays& map, std::int64_t from, double limit);

  /// Whether there is a way.
  bool reach(std::int64_t node);

  /// How uncertain a pose at `node` is, seen from where the search began. Along the way, errors of
  /// heading put what is far off the more astray. `node` must have been reached.
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

/// How uncertain the robot's place is, seen from a node, but for the way since its current node;
/// nothing if all ways have a larger sum of variances than `limit`.
std::optional<Drift> drift_since(const MapArrays& map, std::int64_t node, double limit);

}  // namespace fusionslam::detail
