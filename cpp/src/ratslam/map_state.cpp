// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Converts a map to arrays and back, bit for bit.
#include <algorithm>
#include <cmath>
#include <string>

#include "fusionslam/errors.hpp"
#include "map_arrays.hpp"

namespace fusionslam {
namespace {

using detail::least_share;
using detail::Link;
using detail::MapArrays;
using detail::Measure;
using detail::Pending;

void expect(bool right, const std::string& message) {
  if (!right) throw DataError("state of an experience map: " + message);
}

void expect_size(std::size_t found, std::size_t expected, const char* name) {
  expect(found == expected, std::string(name) + " has " + std::to_string(found) +
                                " values, expected " + std::to_string(expected));
}

void expect_finite(const std::vector<double>& values, const char* name) {
  expect(std::all_of(values.begin(), values.end(),
                     [](double value) { return std::abs(value) <= detail::largest_value; }),
         std::string(name) + " holds a value that is not finite or beyond 1e12");
}

void expect_nodes(const std::vector<std::int64_t>& ids, std::int64_t count, const char* name) {
  for (const std::int64_t id : ids)
    expect(id >= 0 && id < count, std::string(name) + " names node " + std::to_string(id) +
                                      ", there are " + std::to_string(count));
}

void put(std::vector<double>& values, const Measure& measure) {
  values.insert(values.end(), {measure.distance, measure.heading, measure.facing, measure.duration,
                               measure.variance_m, measure.variance_rad});
}

void put(std::vector<double>& values, const Pose2& pose) {
  values.insert(values.end(), {pose.x, pose.y, pose.heading});
}

Measure read_measure(const double* values) {
  constexpr double least = least_share * detail::least_variance;
  expect(values[4] >= least && values[5] >= least, "a link's variance is below any that a map has");
  expect(values[0] >= 0 && values[3] >= 0, "a link's distance or duration is below 0");
  return {
      values[0], detail::wrap_angle(values[1]), detail::wrap_angle(values[2]), values[3], values[4],
      values[5]};
}

Pose2 read_pose(const double* values) {
  return {values[0], values[1], detail::wrap_angle(values[2])};
}

void check_sizes(const MapState& state) {
  const std::size_t links = state.loops.size();
  expect(state.nodes.size() % 3 == 0, "nodes has no three values a node");
  expect_size(state.ends.size(), 2 * links, "ends");
  expect_size(state.links.size(), MapState::link_values * links, "links");
  expect_size(state.robot.size(), MapState::robot_values, "robot");
  expect_size(state.counts.size(), MapState::robot_counts, "counts");
  expect(state.pending_ends.size() % 2 == 0, "pending_ends has no two values a loop");
  expect(state.pending_ends.size() <= 2 * detail::most_pending,
         "pending_ends names " + std::to_string(state.pending_ends.size() / 2) +
             " loops, expected at most " + std::to_string(detail::most_pending));
  expect_size(state.pending.size(), MapState::pending_values * (state.pending_ends.size() / 2),
              "pending");
}

/// Every node but the first was made with a link from an earlier one, so that all are joined.
void expect_joined(const MapState& state, std::int64_t count) {
  std::vector<bool> joined(static_cast<std::size_t>(count));
  for (std::size_t i = 0; i < state.ends.size(); i += 2)
    if (state.ends[i] < state.ends[i + 1])
      joined[static_cast<std::size_t>(state.ends[i + 1])] = true;
  for (std::int64_t node = 1; node < count; ++node)
    expect(joined[static_cast<std::size_t>(node)],
           "no link leads to node " + std::to_string(node) + " from an earlier one");
}

/// Searches add up variances and would never end where a sum could fall.
void check_robot(const std::vector<double>& robot) {
  constexpr std::size_t not_negative[] = {3, 4, 5, 9, 10, 11, 12, 13};
  for (const std::size_t i : not_negative)
    expect(i >= robot.size() || robot[i] >= 0, "robot holds a time, way or variance below 0");
}

void check_values(const MapState& state) {
  const auto count = static_cast<std::int64_t>(state.nodes.size() / 3);
  expect_finite(state.nodes, "nodes");
  expect_finite(state.links, "links");
  expect_finite(state.robot, "robot");
  expect_finite(state.pending, "pending");
  expect_nodes(state.ends, count, "ends");
  for (std::size_t i = 0; i < state.ends.size(); i += 2)
    expect(state.ends[i] != state.ends[i + 1],
           "a link joins node " + std::to_string(state.ends[i]) + " to itself");
  expect_joined(state, count);
  check_robot(state.robot);
  expect_nodes(state.due, count, "due");
  expect_nodes(state.pending_ends, count, "pending_ends");
  for (std::size_t i = 0; i < state.interruptions.size(); ++i)
    expect(state.interruptions[i] > (i ? state.interruptions[i - 1] : 0) &&
               state.interruptions[i] <= count,
           "interruptions has node " + std::to_string(state.interruptions[i]) +
               ", expected ascending ones from 1 to " + std::to_string(count));
  const std::int64_t current = state.counts[0];
  expect(current >= 0 && current < std::max<std::int64_t>(count, 1),
         "the current node is " + std::to_string(current) + ", there are " + std::to_string(count));
}

}  // namespace

MapState ExperienceMap::state() const {
  const MapArrays& map = *map_;
  MapState state;
  for (const Pose2& node : map.nodes) put(state.nodes, node);
  for (const Link& link : map.links) {
    state.ends.insert(state.ends.end(), {link.source, link.target});
    put(state.links, link.measure);
    state.loops.push_back(link.loop);
  }
  state.robot = {
      map.dx,           map.dy,         map.facing,        map.seconds,       map.variance_m,
      map.variance_rad, map.credit,     map.squares_m,     map.squares_rad,   map.arrived_m,
      map.arrived_rad,  map.since_loop, map.way_deviation, map.turn_deviation};
  state.counts = {map.current, map.local_only};
  state.due = map.due;
  for (const Pending& loop : map.pending) {
    state.pending_ends.insert(state.pending_ends.end(), {loop.source, loop.target});
    put(state.pending, loop.offset);
    put(state.pending, loop.place);
    put(state.pending, loop.measure);
  }
  state.interruptions = map.interruptions;
  return state;
}

void ExperienceMap::restore(const MapState& state) {
  check_sizes(state);
  check_values(state);
  auto map = std::make_unique<Storage>();
  map->config = map_->config;
  for (std::size_t i = 0; i < state.nodes.size(); i += 3) {
    map->nodes.push_back(read_pose(&state.nodes[i]));
    map->out.add_node();
    map->in.add_node();
  }
  for (std::size_t i = 0; i < state.loops.size(); ++i) {
    const double* values = &state.links[i * MapState::link_values];
    map->links.push_back(
        {state.ends[2 * i], state.ends[2 * i + 1], read_measure(values), state.loops[i] != 0});
    map->out.add(state.ends[2 * i], static_cast<std::int64_t>(i));
    map->in.add(state.ends[2 * i + 1], static_cast<std::int64_t>(i));
  }
  for (std::size_t i = 0; i < state.pending_ends.size() / 2; ++i) {
    const double* values = &state.pending[i * MapState::pending_values];
    map->pending.push_back({state.pending_ends[2 * i], state.pending_ends[2 * i + 1],
                            read_pose(values), read_pose(values + 3), read_measure(values + 6)});
  }
  const std::vector<double>& robot = state.robot;
  map->dx = robot[0], map->dy = robot[1], map->facing = detail::wrap_angle(robot[2]),
  map->seconds = robot[3];
  map->variance_m = robot[4], map->variance_rad = robot[5], map->credit = robot[6];
  map->squares_m = robot[7], map->squares_rad = robot[8];
  map->arrived_m = robot[9], map->arrived_rad = robot[10];
  map->since_loop = robot[11], map->way_deviation = robot[12], map->turn_deviation = robot[13];
  map->current = state.counts[0];
  map->local_only = state.counts[1] != 0;
  map->due = state.due;
  map->interruptions = state.interruptions;
  map_ = std::move(map);
}

}  // namespace fusionslam
