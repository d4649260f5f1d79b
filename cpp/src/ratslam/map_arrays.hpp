// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The contents of an experience map in plain arrays that grow.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "../mapping/pose_drift.hpp"
#include "fusionslam/ratslam/experience_map.hpp"

namespace fusionslam::detail {

/// No length, angle, time or variance of a map is larger; squares and sums of such are finite.
constexpr double largest_value = 1e12;

/// Share of a measure's variance below which more measures do not lower that of their mean,
/// because systematic errors of odometry do not average out.
constexpr double least_share = 0.25;

/// Loops that wait for others to agree with them; older ones are forgotten.
constexpr std::size_t most_pending = 64;

/// The same angle in (-pi, pi].
inline double wrap_angle(double angle) {
  constexpr double pi = std::numbers::pi;
  if (angle > -pi && angle <= pi) return angle;
  const double turned = std::remainder(angle, 2 * pi);
  return turned <= -pi ? turned + 2 * pi : turned;
}

/// The pose `inner`, given in the frame of `outer`, in outer's parent frame.
inline Pose2 compose(const Pose2& outer, const Pose2& inner) {
  const double c = std::cos(outer.heading), s = std::sin(outer.heading);
  return {outer.x + c * inner.x - s * inner.y, outer.y + s * inner.x + c * inner.y,
          wrap_angle(outer.heading + inner.heading)};
}

/// The pose `other` in the frame of `pose`.
inline Pose2 relative_pose(const Pose2& pose, const Pose2& other) {
  const double c = std::cos(pose.heading), s = std::sin(pose.heading);
  const double dx = other.x - pose.x, dy = other.y - pose.y;
  return {c * dx + s * dy, c * dy - s * dx, wrap_angle(other.heading - pose.heading)};
}

/// Odometry between two poses, in the frame of the first.
struct Measure {
  double distance = 0, heading = 0, facing = 0, duration = 0;
  double variance_m = 0, variance_rad = 0;

  Pose2 pose() const {
    return {distance * std::cos(heading), distance * std::sin(heading), facing};
  }
};

/// The part of a measure's turn before its way: half of it along an arc.
inline double turn_before_way(const Measure& measure) {
  const double heading = measure.heading, facing = measure.facing;
  return heading * facing > 0 && std::abs(heading) <= std::abs(facing) ? heading : 0;
}

struct Link {
  std::int64_t source = 0, target = 0;
  Measure measure;
  bool loop = false;  ///< measured by a view; false: by odometry alone
};

/// A loop that has not been accepted yet.
struct Pending {
  std::int64_t source = 0, target = 0;
  Pose2 offset;     ///< the robot in the frame of the source
  Pose2 place;      ///< the robot in the frame of the target, as the view has it
  Measure measure;  ///< from source to target; its distance, heading, facing follow from the poses
};

/// Links of each node in the order of creation, as linked lists.
struct Adjacency {
  std::vector<std::int64_t> first, last, next;

  void add_node() {
    first.push_back(-1);
    last.push_back(-1);
  }
  void add(std::int64_t node, std::int64_t link) {
    next.push_back(-1);
    (first[node] < 0 ? first[node] : next[last[node]]) = link;
    last[node] = link;
  }
};

struct MapArrays {
  ExperienceMapConfig config;
  std::vector<Pose2> nodes;
  std::vector<Link> links;
  Adjacency out, in;

  std::int64_t current = 0;
  double dx = 0, dy = 0, facing = 0;  ///< since the current node, in the frame of the map
  double seconds = 0, variance_m = 0, variance_rad = 0;
  double arrived_m = 0, arrived_rad = 0;  ///< variances of its pose when it came to that node
  double since_loop = 0;                  ///< m, driven since the last loop
  double way_deviation = 0, turn_deviation = 0;  ///< of odometry's factors

  std::vector<std::int64_t> due;          ///< nodes whose surroundings are to be relaxed
  double credit = 0;                      ///< nodes that may be moved by now
  bool local_only = false;                ///< parts were relaxed since the whole was
  double squares_m = 0, squares_rad = 0;  ///< sums of the links' squared errors

  std::vector<Pending> pending;
  std::vector<std::int64_t> interruptions;  ///< first node after each that no loop has resolved

  std::vector<int> rows;  ///< of each node in the part that is being solved; -1 elsewhere

  Pose2 pose() const {
    const Pose2 node = nodes.empty() ? Pose2{} : nodes[current];
    return {node.x + dx, node.y + dy, facing};
  }
  bool robust() const { return config.preset == MapPreset::robust; }
  std::int64_t size() const { return static_cast<std::int64_t>(nodes.size()); }

  /// Calls work(link, other end) for every link of a node.
  template <class Work>
  void around(std::int64_t node, Work&& work) const {
    for (auto link = out.first[node]; link >= 0; link = out.next[link])
      work(link, links[link].target);
    for (auto link = in.first[node]; link >= 0; link = in.next[link])
      work(link, links[link].source);
  }
};

/// Runs `loops` sweeps as the reference does.
Relaxation relax_by_sweeps(MapArrays& map);

/// Relaxes the changed parts, or the whole map, by Gauss-Newton.
Relaxation relax_by_newton(MapArrays& map, bool whole);

LoopCheck check_loop(MapArrays& map, const MapAction& action);

/// Pose of the robot in the frame of the node that it arrives at, and its variances.
struct Arrival {
  Pose2 offset;
  double variance_m = 0, variance_rad = 0;
};

/// Whether a loop fits odometry.
bool fits_odometry(const MapArrays& map, const Pending& loop);

/// Fuses odometry and the view unless they contradict each other; then the view alone counts.
/// `repeats`: factor on the variances of the view.
Arrival arrival_by(const MapArrays& map, const Pending& loop, double repeats);

/// First node after the latest unresolved interruption of odometry between the target and the
/// robot, which may not be there yet; -1 if there is none.
std::int64_t interruption_before(const MapArrays& map, const Pending& loop);

/// Numbers of the pending loops that agree with this one.
std::vector<std::size_t> agreeing_loops(const MapArrays& map, const Pending& loop);

/// The loop that an action claims, from where the robot is.
Pending build_loop(const MapArrays& map, const MapAction& action);

/// Error of place and rotation of a link on the map: target's place less its expected one, in the
/// frame of the map.
inline Pose2 link_error(const MapArrays& map, const Link& link) {
  const Pose2 &from = map.nodes[link.source], &to = map.nodes[link.target];
  const double way = from.heading + link.measure.heading;
  return {to.x - from.x - link.measure.distance * std::cos(way),
          to.y - from.y - link.measure.distance * std::sin(way),
          wrap_angle(to.heading - from.heading - link.measure.facing)};
}

}  // namespace fusionslam::detail

namespace fusionslam {

struct ExperienceMap::Storage : detail::MapArrays {};

}  // namespace fusionslam
