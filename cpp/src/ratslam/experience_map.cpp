// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "fusionslam/ratslam/experience_map.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "fusionslam/errors.hpp"
#include "map_arrays.hpp"

namespace fusionslam {
namespace detail {
namespace {

/// Standard deviations of the way that a robot was carried.
constexpr double anywhere_m = 100, anywhere_rad = 3;

/// A view counts at least as one of so many.
constexpr double most_repeats = 50;

void arrive(MapArrays& map, std::int64_t node, const Arrival& arrival) {
  map.current = node;
  const Pose2 pose = compose(map.nodes[node], arrival.offset);
  map.dx = pose.x - map.nodes[node].x;
  map.dy = pose.y - map.nodes[node].y;
  map.facing = pose.heading;
  map.variance_m = map.variance_rad = 0;
  map.arrived_m = arrival.variance_m;
  map.arrived_rad = arrival.variance_rad;
  if (map.robust()) map.seconds = 0;
}

/// The link between two nodes, in either direction; -1 if there is none.
std::int64_t link_between(const MapArrays& map, std::int64_t one, std::int64_t other) {
  std::int64_t found = -1;
  map.around(one, [&](std::int64_t link, std::int64_t end) {
    if (end == other && found < 0) found = link;
  });
  return found;
}

void add_link(MapArrays& map, const Link& link) {
  const auto number = static_cast<std::int64_t>(map.links.size());
  map.links.push_back(link);
  map.out.add(link.source, number);
  map.in.add(link.target, number);
}

/// Place and rotation of the robot in the frame of the current node by odometry, with variances.
Measure measure_odometry(const MapArrays& map, const Pose2& node) {
  Measure measure;
  measure.distance = std::hypot(map.dx, map.dy);
  measure.heading = wrap_angle(std::atan2(map.dy, map.dx) - node.heading);
  measure.facing = wrap_angle(map.facing - node.heading);
  measure.duration = map.seconds;
  // A heading error that is present from the start moves the end by all of the distance.
  const double square = measure.distance * measure.distance;
  measure.variance_m = least_variance + map.variance_m + map.arrived_m +
                       swing_variance(map.variance_rad, measure.distance) +
                       map.arrived_rad * square;
  measure.variance_rad = least_variance + map.variance_rad + map.arrived_rad;
  return measure;
}

void create_node(MapArrays& map, const MapAction& action) {
  const Pose2 pose = map.pose();
  Link link{map.current, action.target, {}, false};
  if (action.target > 0) link.measure = measure_odometry(map, map.nodes[map.current]);
  map.nodes.push_back(pose);
  map.out.add_node();
  map.in.add_node();
  if (!map.robust()) link.measure.facing += action.relative_rotation;
  link.measure.facing = wrap_angle(link.measure.facing);
  if (action.target > 0) add_link(map, link);
  // The reference does not reset odometry at its first node: the motion to it counts twice.
  if (action.target > 0 || map.robust()) arrive(map, action.target, {});
}

void create_reference_edge(MapArrays& map, const MapAction& action) {
  if (action.target != map.current && link_between(map, map.current, action.target) < 0) {
    Link link{map.current, action.target, measure_odometry(map, map.nodes[map.current]), true};
    link.measure.facing = wrap_angle(link.measure.facing + action.relative_rotation);
    add_link(map, link);
  }
  arrive(map, action.target, {{0, 0, action.relative_rotation}});
}

void add_squares(MapArrays& map, const Link& link, double sign) {
  const Pose2 error = link_error(map, link);
  map.squares_m += sign * (error.x * error.x + error.y * error.y);
  map.squares_rad += sign * error.heading * error.heading;
}

Measure reverse(const Measure& measure) {
  Measure back = measure;
  back.heading = wrap_angle(measure.heading + std::numbers::pi - measure.facing);
  back.facing = wrap_angle(-measure.facing);
  return back;
}

/// The variance after one more measure.
double variance_with(double old, double more) {
  return std::min(old, std::max(old * more / (old + more), least_share * more));
}

/// Mean of both measures, weighted by their certainty.
Measure average(const Measure& old, const Measure& more) {
  const Pose2 a = old.pose(), b = more.pose();
  const double place = old.variance_m / (old.variance_m + more.variance_m);
  const double rotation = old.variance_rad / (old.variance_rad + more.variance_rad);
  const double x = a.x + place * (b.x - a.x), y = a.y + place * (b.y - a.y);
  Measure mean = old;
  mean.distance = std::hypot(x, y);
  mean.heading = mean.distance > 0 ? std::atan2(y, x) : 0;
  mean.facing = wrap_angle(a.heading + rotation * wrap_angle(b.heading - a.heading));
  mean.duration = old.duration + place * (more.duration - old.duration);
  mean.variance_m = variance_with(old.variance_m, more.variance_m);
  mean.variance_rad = variance_with(old.variance_rad, more.variance_rad);
  return mean;
}

void add_loop(MapArrays& map, const Pending& loop) {
  if (loop.source == loop.target) return;
  const std::int64_t known = link_between(map, loop.source, loop.target);
  if (known < 0) {
    add_link(map, {loop.source, loop.target, loop.measure, true});
    add_squares(map, map.links.back(), 1);
  } else {
    Link& link = map.links[known];
    add_squares(map, link, -1);
    const bool along = link.source == loop.source;
    link.measure = average(link.measure, along ? loop.measure : reverse(loop.measure));
    add_squares(map, link, 1);
  }
  map.due.push_back(loop.source);
  map.due.push_back(loop.target);
}

/// Forgets what odometry said of a way.
void loosen(Link& link) {
  link.measure.variance_m = anywhere_m * anywhere_m;
  link.measure.variance_rad = anywhere_rad * anywhere_rad;
}

/// Moves the nodes since an interruption so that the robot is where the loop says. What odometry
/// and earlier loops said of the way between them and older nodes no longer counts.
void rejoin(MapArrays& map, std::int64_t first, const Pending& loop) {
  const Pose2 claimed = compose(map.nodes[loop.target], loop.place);
  const Pose2 robot = map.pose();
  const Pose2 motion = compose(claimed, relative_pose(robot, {}));
  std::vector<std::int64_t> across;
  for (std::int64_t node = first; node < map.size(); ++node)
    map.around(node, [&](std::int64_t link, std::int64_t other) {
      if (other < first) across.push_back(link);
    });
  for (const std::int64_t link : across) add_squares(map, map.links[link], -1);
  for (std::int64_t node = first; node < map.size(); ++node)
    map.nodes[node] = compose(motion, map.nodes[node]);
  for (const std::int64_t link : across) {
    Link& between = map.links[link];
    const Pose2 way = relative_pose(map.nodes[between.source], map.nodes[between.target]);
    between.measure.distance = std::hypot(way.x, way.y);
    between.measure.heading = between.measure.distance > 0 ? std::atan2(way.y, way.x) : 0;
    between.measure.facing = way.heading;
    loosen(between);
    add_squares(map, between, 1);
  }
  const Pose2& node = map.nodes[map.current];
  map.dx = claimed.x - node.x, map.dy = claimed.y - node.y, map.facing = claimed.heading;
}

/// A loop to a node before interruptions of odometry resolves them. Returns whether the way by
/// odometry from the current node is known.
bool resolve_interruptions(MapArrays& map, const Pending& loop) {
  const std::int64_t first = interruption_before(map, loop);
  if (first < 0) return true;
  const bool fits = fits_odometry(map, loop), has_nodes = first < map.size();
  std::erase_if(map.interruptions, [&](std::int64_t node) {
    // Parts in between, which the robot passed without a loop, stay where they are, loosely.
    if (!fits && node > loop.target && node < first) loosen(map.links[map.in.first[node]]);
    return node > loop.target;
  });
  if (!fits && has_nodes) rejoin(map, first, loop);
  return fits || has_nodes;
}

/// Number of loops that say the same as the next one: views that follow closely upon each other err
/// alike, so that together they tell no more than one of them.
double count_repeats(const MapArrays& map) {
  const double alike = 2 * map.config.place_m;
  return std::clamp(alike / std::max(map.since_loop, 1e-9), 1.0, most_repeats);
}

void create_edge(MapArrays& map, const MapAction& action) {
  if (!resolve_interruptions(map, build_loop(map, action))) {
    arrive(map, action.target,
           {{action.relative_x, action.relative_y, wrap_angle(action.relative_rotation)}});
    return;
  }
  Pending loop = build_loop(map, action);
  const double repeats = count_repeats(map);
  const Arrival arrival = arrival_by(map, loop, repeats);
  loop.measure.variance_m += (repeats - 1) * map.config.place_m * map.config.place_m;
  loop.measure.variance_rad += (repeats - 1) * map.config.place_rad * map.config.place_rad;
  map.since_loop = 0;
  auto confirmed = agreeing_loops(map, loop);
  for (const std::size_t number : confirmed) add_loop(map, map.pending[number]);
  for (auto number = confirmed.rbegin(); number != confirmed.rend(); ++number)
    map.pending.erase(map.pending.begin() + static_cast<std::ptrdiff_t>(*number));
  add_loop(map, loop);
  arrive(map, action.target, arrival);
}

void check_finite(const MapAction& action) {
  const double values[] = {action.relative_rotation, action.relative_x, action.relative_y};
  if (!std::all_of(values, values + 3,
                   [](double value) { return std::abs(value) <= largest_value; }))
    throw DataError("edge to node " + std::to_string(action.target) +
                    ": relative rotation or place is not finite or beyond 1e12");
}

void check_source(const MapArrays& map, const MapAction& action) {
  if (map.size() > 0 && action.source != map.current)
    throw DataError("action from node " + std::to_string(action.source) + " to node " +
                    std::to_string(action.target) + ": the robot is at node " +
                    std::to_string(map.current));
}

void check_edge(const MapArrays& map, const MapAction& action) {
  if (action.target < 0 || action.target >= map.size())
    throw DataError("edge to node " + std::to_string(action.target) + ": there are " +
                    std::to_string(map.size()));
  check_source(map, action);
  check_finite(action);
}

}  // namespace

Pending build_loop(const MapArrays& map, const MapAction& action) {
  const Pose2& node = map.nodes[map.current];
  Pending loop;
  loop.source = map.current;
  loop.target = action.target;
  loop.offset = relative_pose(node, map.pose());
  loop.place = {action.relative_x, action.relative_y, wrap_angle(action.relative_rotation)};
  loop.measure = measure_odometry(map, node);
  const Pose2 link = compose(loop.offset, relative_pose(loop.place, {}));
  loop.measure.distance = std::hypot(link.x, link.y);
  loop.measure.heading = loop.measure.distance > 0 ? std::atan2(link.y, link.x) : 0;
  loop.measure.facing = link.heading;
  loop.measure.variance_m += map.config.place_m * map.config.place_m;
  loop.measure.variance_rad += map.config.place_rad * map.config.place_rad;
  return loop;
}

}  // namespace detail

using namespace detail;

ExperienceMap::ExperienceMap(const ExperienceMapConfig& config)
    : map_(std::make_unique<Storage>()) {
  validate(config);
  map_->config = config;
  map_->facing = wrap_angle(config.initial_heading);
}
ExperienceMap::~ExperienceMap() = default;
ExperienceMap::ExperienceMap(ExperienceMap&&) noexcept = default;
ExperienceMap& ExperienceMap::operator=(ExperienceMap&&) noexcept = default;

void ExperienceMap::mark_interruption() {
  MapArrays& map = *map_;
  if (!map.robust() || map.nodes.empty()) return;
  if (map.interruptions.empty() || map.interruptions.back() != map.size())
    map.interruptions.push_back(map.size());
  // Loops agree on the error of one odometry, and this is another one.
  map.pending.clear();
}

void ExperienceMap::mark_interruption_before(std::int64_t node) {
  MapArrays& map = *map_;
  if (node < 1 || node > map.size())
    throw DataError("interruption before node " + std::to_string(node) +
                    ": expected one from 1 to " + std::to_string(map.size()));
  if (!map.robust()) return;
  std::erase_if(map.interruptions, [&](std::int64_t other) { return other >= node; });
  map.interruptions.push_back(node);
  map.pending.clear();
}

void ExperienceMap::on_odometry(double v, double w, double dt) {
  MapArrays& map = *map_;
  const ExperienceMapConfig& config = map.config;
  const double way = v * dt, turn = w * dt, facing = wrap_angle(map.facing + turn);
  const double dx = map.dx + way * std::cos(facing), dy = map.dy + way * std::sin(facing);
  const double seconds = map.seconds + dt;
  // Not finite if any of the values is not; v and w count even if dt is 0.
  const double largest = std::abs(dx) + std::abs(dy) + std::abs(turn) + seconds;
  if (!(largest <= largest_value) || dt < 0)
    throw DataError("odometry v " + std::to_string(v) + " m/s, w " + std::to_string(w) +
                    " rad/s, dt " + std::to_string(dt) +
                    " s: expected finite values, no way, turn or time beyond 1e12, and a time that "
                    "is not negative");
  map.dx = dx, map.dy = dy, map.facing = facing, map.seconds = seconds;
  map.since_loop += std::abs(way);
  map.variance_m += place_variance(config.drift_m, std::abs(way));
  map.variance_rad +=
      turn_variance(config.drift_turn, std::abs(turn), config.drift_heading, std::abs(way));
}

void ExperienceMap::rescale_odometry(double way, double turn) {
  MapArrays& map = *map_;
  if (!(way > 0 && turn > 0 && way <= largest_value && turn <= largest_value))
    throw DataError("factors of odometry " + std::to_string(way) + " and " + std::to_string(turn) +
                    ": expected finite values above 0");
  for (Link& link : map.links) {
    if (link.loop) continue;
    add_squares(map, link, -1);
    link.measure.distance = std::min(way * link.measure.distance, largest_value);
    link.measure.heading =
        wrap_angle(link.measure.heading + (turn - 1) * turn_before_way(link.measure));
    link.measure.facing = wrap_angle(turn * link.measure.facing);
    add_squares(map, link, 1);
  }
  map.local_only = !map.links.empty();
}

void ExperienceMap::set_odometry_deviations(double way, double turn) {
  if (!(way >= 0 && turn >= 0 && way <= largest_value && turn <= largest_value))
    throw DataError("deviations of odometry's factors " + std::to_string(way) + " and " +
                    std::to_string(turn) + ": expected finite values of 0 or more");
  map_->way_deviation = way, map_->turn_deviation = turn;
}

LoopCheck ExperienceMap::check(const MapAction& action) {
  if (action.kind != ActionKind::create_edge) return {};
  check_edge(*map_, action);
  return check_loop(*map_, action);
}

void ExperienceMap::apply(const MapAction& action) {
  MapArrays& map = *map_;
  if (action.kind == ActionKind::none) return;
  if (action.kind == ActionKind::create_node) {
    if (action.target != map.size())
      throw DataError("node " + std::to_string(action.target) + ": expected " +
                      std::to_string(map.size()) + ", the next one");
    check_source(map, action);
    check_finite(action);
    create_node(map, action);
    return;
  }
  check_edge(map, action);
  map.robust() ? create_edge(map, action) : create_reference_edge(map, action);
}

Relaxation ExperienceMap::relax(bool whole) {
  return map_->robust() ? relax_by_newton(*map_, whole) : relax_by_sweeps(*map_);
}

std::size_t ExperienceMap::size() const { return map_->nodes.size(); }
std::size_t ExperienceMap::links() const { return map_->links.size(); }
Pose2 ExperienceMap::node(std::size_t id) const { return map_->nodes.at(id); }
std::int64_t ExperienceMap::current() const { return map_->current; }
Pose2 ExperienceMap::pose() const { return map_->pose(); }
const ExperienceMapConfig& ExperienceMap::config() const { return map_->config; }

MapLink ExperienceMap::link(std::size_t number) const {
  const Link& link = map_->links.at(number);
  const Measure& measure = link.measure;
  // The reference's relaxation weights all links equally, and metres like radians.
  const bool weighted = map_->robust();
  const double sd_m = weighted ? std::sqrt(measure.variance_m) : 1;
  const double sd_rad = weighted ? std::sqrt(measure.variance_rad) : 1;
  return {
      link.source, link.target, measure.distance, measure.heading, measure.facing, measure.duration,
      sd_m,        sd_rad};
}

Pose2 ExperienceMap::offset() const {
  return relative_pose(map_->nodes.empty() ? Pose2{} : map_->nodes[map_->current], map_->pose());
}

}  // namespace fusionslam
