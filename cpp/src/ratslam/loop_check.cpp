// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Accepts loops that fit odometry, and loops that agree with each other (pairwise consistency as in
// Mangelson et al. 2018).
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <sstream>
#include <vector>

#include "drift.hpp"
#include "map_arrays.hpp"

namespace fusionslam::detail {
namespace {

constexpr double without_limit = std::numeric_limits<double>::infinity();
// Odometry whose variance is so many times a view's does not count beside it.
constexpr double unsure = 100;

/// Relative pose of two loops and its uncertainty along one side: the robot's own path between
/// them, or the path between their targets.
struct Side {
  Pose2 between;
  Drift drift;
};

/// Compares loops with one of them.
class Companion {
 public:
  Companion(const MapArrays& map, const Pending& loop)
      : map_(map),
        loop_(loop),
        limit_(map.config.agreement_m * map.config.agreement_m),
        own_(map, loop.source, limit_),
        seen_(map, loop.target, limit_) {}

  bool agrees(const Pending& other) {
    if (other.target == loop_.target) return false;
    if (!own_.reach(other.source) || !seen_.reach(other.target)) return false;
    const Side own = side(own_, loop_.source, loop_.offset, other.source, other.offset);
    const Side seen = side(seen_, loop_.target, loop_.place, other.target, other.place);
    const double largest = own.drift.largest() + seen.drift.largest();
    // Two loops at one place are one loop.
    const double place_m = map_.config.place_m, place_rad = map_.config.place_rad;
    if (std::hypot(own.between.x, own.between.y) < 2 * place_m || largest > limit_) return false;
    const double x = own.between.x - seen.between.x, y = own.between.y - seen.between.y;
    const double turn = wrap_angle(own.between.heading - seen.between.heading);
    const double sigmas = map_.config.sigmas;
    return std::hypot(x, y) <= sigmas * std::sqrt(largest + 2 * place_m * place_m) &&
           std::abs(turn) <= sigmas * std::sqrt(own.drift.turn(0, 0) + seen.drift.turn(0, 0) +
                                                2 * place_rad * place_rad);
  }

 private:
  Side side(const DriftSearch& search, std::int64_t from, const Pose2& from_offset, std::int64_t to,
            const Pose2& to_offset) const {
    const Pose2 one = compose(map_.nodes[from], from_offset);
    const Pose2 other = compose(map_.nodes[to], to_offset);
    return {relative_pose(one, other), search.drift(to, other)};
  }

  const MapArrays& map_;
  const Pending& loop_;
  double limit_;
  DriftSearch own_, seen_;
};

/// Size of the largest group of candidates that agree with one another, found greedily from each of
/// them. All candidates agree with the loop.
std::size_t largest_group(const MapArrays& map, const std::vector<std::size_t>& candidates) {
  const std::size_t count = candidates.size();
  std::vector<std::vector<bool>> agrees(count, std::vector<bool>(count));
  for (std::size_t i = 0; i < count; ++i) {
    Companion companion(map, map.pending[candidates[i]]);
    for (std::size_t j = 0; j < i; ++j)
      agrees[i][j] = agrees[j][i] = companion.agrees(map.pending[candidates[j]]);
  }
  std::size_t largest = 0;
  for (std::size_t first = 0; first < count; ++first) {
    std::vector<std::size_t> group{first};
    for (std::size_t i = count; i-- > 0;)
      if (std::all_of(group.begin(), group.end(), [&](std::size_t one) { return agrees[one][i]; }))
        group.push_back(i);
    largest = std::max(largest, group.size());
  }
  return largest;
}

bool same(const Pending& one, const Pending& other) {
  return one.source == other.source && one.target == other.target &&
         one.offset.x == other.offset.x && one.offset.y == other.offset.y &&
         one.offset.heading == other.offset.heading;
}

void remember(MapArrays& map, const Pending& loop) {
  std::erase_if(map.pending, [&](const Pending& other) { return same(loop, other); });
  if (map.pending.size() == most_pending) map.pending.erase(map.pending.begin());
  map.pending.push_back(loop);
}

LoopCheck compare_with_map(const MapArrays& map, const Pending& loop, const Drift& drift) {
  const Pose2 robot = map.pose(), claimed = compose(map.nodes[loop.target], loop.place);
  // With the variances of the motion since the current node and of the view.
  Drift total = drift;
  total.add(Drift::isotropic(loop.measure.variance_m, loop.measure.variance_rad), {0, 0});
  const DriftFit fit =
      total.fit({claimed.x - robot.x, claimed.y - robot.y},
                Drift::Turn(wrap_angle(claimed.heading - robot.heading)), map.config.sigmas);
  LoopCheck check;
  check.error_m = fit.error_m;
  check.error_rad = fit.error_rad;
  check.allowed_m = fit.allowed_m;
  check.allowed_rad = fit.allowed_rad;
  check.accepted = check.error_m <= check.allowed_m && check.error_rad <= check.allowed_rad;
  return check;
}

std::string words(const LoopCheck& check) {
  std::ostringstream text;
  text.precision(3);
  text << check.error_m << " m and " << check.error_rad
       << " rad from where odometry has the robot, " << check.allowed_m << " m and "
       << check.allowed_rad << " rad are to be expected";
  return text.str();
}

}  // namespace

std::int64_t interruption_before(const MapArrays& map, const Pending& loop) {
  // The robot is past all of them, the last one included if it has no node yet.
  if (map.interruptions.empty() || loop.target >= map.interruptions.back()) return -1;
  return map.interruptions.back();
}

bool fits_odometry(const MapArrays& map, const Pending& loop) {
  const auto drift = drift_since(map, loop.target, without_limit);
  return drift && compare_with_map(map, loop, *drift).accepted;
}

Arrival arrival_by(const MapArrays& map, const Pending& loop, double repeats) {
  const double view_m = map.config.place_m * map.config.place_m;
  const double view_rad = map.config.place_rad * map.config.place_rad;
  const double place_m = repeats * view_m, place_rad = repeats * view_rad;
  const auto drift = drift_since(map, loop.target, unsure * (place_m + place_rad));
  if (!drift || !compare_with_map(map, loop, *drift).accepted)
    return {loop.place, place_m, place_rad};
  // The variances of the link hold those of the motion since the current node and of the view.
  const double m = drift->largest() + loop.measure.variance_m - view_m;
  const double rad = drift->turn(0, 0) + loop.measure.variance_rad - view_rad;
  const double share_m = m / (m + place_m), share_rad = rad / (rad + place_rad);
  const Pose2 seen = relative_pose(map.nodes[loop.target], map.pose());
  return {{seen.x + share_m * (loop.place.x - seen.x), seen.y + share_m * (loop.place.y - seen.y),
           wrap_angle(seen.heading + share_rad * wrap_angle(loop.place.heading - seen.heading))},
          share_m * place_m,
          share_rad * place_rad};
}

std::vector<std::size_t> agreeing_loops(const MapArrays& map, const Pending& loop) {
  std::vector<std::size_t> found;
  if (map.pending.empty()) return found;
  Companion companion(map, loop);
  for (std::size_t i = 0; i < map.pending.size(); ++i)
    if (!same(map.pending[i], loop) && companion.agrees(map.pending[i])) found.push_back(i);
  return found;
}

LoopCheck check_loop(MapArrays& map, const MapAction& action) {
  const Pending loop = build_loop(map, action);
  // A target without a path to it may be anywhere.
  const Drift drift = drift_since(map, loop.target, without_limit)
                          .value_or(Drift::isotropic(without_limit, without_limit));
  LoopCheck check = compare_with_map(map, loop, drift);
  if (!map.robust()) {
    check.accepted = true;
    check.reason = "the openratslam preset closes every loop";
    return check;
  }
  if (check.accepted) {
    check.reason = "fits odometry: " + words(check);
    return check;
  }
  const auto candidates = agreeing_loops(map, loop);
  const std::size_t group = 1 + largest_group(map, candidates);
  const double farthest = std::max(1.0, map.config.agreed_sigmas / map.config.sigmas);
  const std::int64_t interruption = interruption_before(map, loop);
  const bool interrupted = interruption >= 0;
  const int needed = interrupted ? map.config.rejoin : map.config.agreeing;
  const bool beyond = !interrupted && (check.error_m > farthest * check.allowed_m ||
                                       check.error_rad > farthest * check.allowed_rad);
  check.accepted = !beyond && group >= static_cast<std::size_t>(needed);
  check.reason = words(check) + "; " + std::to_string(group - 1) + " earlier loops agree with it" +
                 (interrupted ? " since odometry was interrupted" : "") +
                 (check.accepted ? ""
                  : beyond       ? ", too far off for any number"
                                 : ", expected " + std::to_string(needed - 1));
  // Before the first node after an interruption, the robot's offset to its node means nothing.
  if (!check.accepted && interruption != map.size()) remember(map, loop);
  return check;
}

}  // namespace fusionslam::detail
