// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Places and headings of nodes by weighted least squares over links (Gauss-Newton on SE(2), sparse
// LDLT), of the nodes around a change or of the whole map.
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <vector>

#include "../detail/interrupt.hpp"
#include "map_arrays.hpp"

namespace fusionslam::detail {
namespace {

using Matrix = Eigen::SparseMatrix<double>;
using Vector = Eigen::VectorXd;

constexpr std::int64_t first_part = 64;  // nodes that are relaxed around a change at first
constexpr int part_growth = 4;
constexpr int most_steps = 50;
constexpr int most_halvings = 8;
// A step that is made with the factors of an earlier one costs so much less.
constexpr double chord_cost = 0.125;

/// Some nodes of the map, all others held where they are, and the links that they are part of.
class Part {
 public:
  Part(MapArrays& map, std::vector<std::int64_t> nodes) : map_(map), nodes_(std::move(nodes)) {
    row_.reserve(nodes_.size() * 2);
    for (std::size_t i = 0; i < nodes_.size(); ++i) row_[nodes_[i]] = static_cast<int>(3 * i);
    for (const std::int64_t node : nodes_)
      map_.around(node, [&](std::int64_t link, std::int64_t other) {
        if (row(other) < 0 || node < other) links_.push_back(link);
      });
    std::sort(links_.begin(), links_.end());
  }

  std::int64_t size() const { return static_cast<std::int64_t>(nodes_.size()); }
  int row(std::int64_t node) const {
    const auto found = row_.find(node);
    return found == row_.end() ? -1 : found->second;
  }

  struct Sums {
    double cost = 0, squares_m = 0, squares_rad = 0;
  };

  Sums sums() const {
    Sums sums;
    for (const std::int64_t number : links_) {
      const Link& link = map_.links[number];
      const Pose2 error = link_error(map_, link);
      const double m = error.x * error.x + error.y * error.y, rad = error.heading * error.heading;
      sums.squares_m += m, sums.squares_rad += rad;
      const double square = m / link.measure.variance_m + rad / link.measure.variance_rad;
      const double limit = map_.config.outlier;
      sums.cost +=
          !link.loop || square <= limit * limit ? square : limit * (2 * std::sqrt(square) - limit);
    }
    return sums;
  }

  /// Half the gradient and, if asked for, half of Gauss and Newton's approximation of the Hessian.
  void linearize(Vector& gradient, std::vector<Eigen::Triplet<double>>* entries) const {
    gradient.setZero(3 * size());
    for (const std::int64_t number : links_) {
      const Link& link = map_.links[number];
      const Pose2 error = link_error(map_, link);
      const double way = map_.nodes[link.source].heading + link.measure.heading;
      // Derivatives of the error of place by the source's heading.
      const double turn_x = link.measure.distance * std::sin(way);
      const double turn_y = -link.measure.distance * std::cos(way);
      double place = 1 / link.measure.variance_m, rotation = 1 / link.measure.variance_rad;
      const double weight = pull(link, error);
      place *= weight, rotation *= weight;
      const int from = row(link.source), to = row(link.target);
      if (from >= 0) {
        gradient[from] -= place * error.x;
        gradient[from + 1] -= place * error.y;
        gradient[from + 2] +=
            place * (turn_x * error.x + turn_y * error.y) - rotation * error.heading;
      }
      if (to >= 0) {
        gradient[to] += place * error.x;
        gradient[to + 1] += place * error.y;
        gradient[to + 2] += rotation * error.heading;
      }
      if (entries) add_entries(*entries, from, to, turn_x, turn_y, place, rotation);
    }
  }

  /// Moves the nodes by `part` of a step; the robot goes with its node.
  void move(const Vector& step, double part) {
    for (std::int64_t i = 0; i < size(); ++i) {
      Pose2& node = map_.nodes[nodes_[i]];
      const double turn = part * step[3 * i + 2];
      node.x += part * step[3 * i];
      node.y += part * step[3 * i + 1];
      node.heading = wrapped(node.heading + turn);
    }
  }

  std::vector<Pose2> poses() const {
    std::vector<Pose2> poses;
    poses.reserve(nodes_.size());
    for (const std::int64_t node : nodes_) poses.push_back(map_.nodes[node]);
    return poses;
  }
  void put_back(const std::vector<Pose2>& poses) {
    for (std::size_t i = 0; i < nodes_.size(); ++i) map_.nodes[nodes_[i]] = poses[i];
  }

  /// The farthest that a node next to the part would move by itself; its links' pull against their
  /// stiffness.
  double unrest_beside() const {
    double farthest = 0;
    for (const std::int64_t inside : nodes_)
      map_.around(inside, [&](std::int64_t, std::int64_t other) {
        if (row(other) < 0 && other != 0) farthest = std::max(farthest, unrest(other));
      });
    return farthest;
  }

 private:
  double pull(const Link& link, const Pose2& error) const {
    if (!link.loop) return 1;
    const double size =
        std::sqrt((error.x * error.x + error.y * error.y) / link.measure.variance_m +
                  error.heading * error.heading / link.measure.variance_rad);
    return size <= map_.config.outlier ? 1 : map_.config.outlier / size;
  }

  double unrest(std::int64_t node) const {
    double x = 0, y = 0, stiffness = 0;
    map_.around(node, [&](std::int64_t number, std::int64_t) {
      const Link& link = map_.links[number];
      const Pose2 error = link_error(map_, link);
      const double weight = pull(link, error) / link.measure.variance_m;
      const double sign = link.source == node ? -1 : 1;
      x += sign * weight * error.x, y += sign * weight * error.y;
      stiffness += weight;
    });
    return stiffness > 0 ? std::hypot(x, y) / stiffness : 0;
  }

  static void add_entries(std::vector<Eigen::Triplet<double>>& entries, int from, int to,
                          double turn_x, double turn_y, double place, double rotation) {
    const auto add = [&](int row, int column, double value) {
      // The lower triangle alone.
      entries.emplace_back(std::max(row, column), std::min(row, column), value);
    };
    for (const int end : {from, to})
      if (end >= 0) {
        add(end, end, place);
        add(end + 1, end + 1, place);
        add(end + 2, end + 2, rotation);
      }
    if (from >= 0) {
      add(from, from + 2, -place * turn_x);
      add(from + 1, from + 2, -place * turn_y);
      add(from + 2, from + 2, place * (turn_x * turn_x + turn_y * turn_y));
    }
    if (from >= 0 && to >= 0) {
      add(from, to, -place);
      add(from + 1, to + 1, -place);
      add(from + 2, to + 2, -rotation);
      add(from + 2, to, place * turn_x);
      add(from + 2, to + 1, place * turn_y);
    }
  }

  MapArrays& map_;
  std::vector<std::int64_t> nodes_;
  std::unordered_map<std::int64_t, int> row_;
  std::vector<std::int64_t> links_;
};

/// What solving a part came to.
struct Solved {
  double step_m = 0;
  std::int64_t steps = 0;
  double work = 0;  ///< nodes
  bool converged = false;
};

double farthest(const Vector& step) {
  double most = 0;
  for (Eigen::Index i = 0; i + 2 < step.size(); i += 3)
    most = std::max({most, std::hypot(step[i], step[i + 1]), std::abs(step[i + 2])});
  return most;
}

/// Gauss-Newton steps, each made shorter until it lessens the sum; factors serve as long as they
/// bring the map nearer quickly.
Solved solve(MapArrays& map, Part& part) {
  Solved solved;
  Eigen::SimplicialLDLT<Matrix> factors;
  Vector gradient;
  std::vector<Eigen::Triplet<double>> entries;
  Part::Sums now = part.sums();
  // The whole is at rest again only after this.
  map.local_only = true;
  bool factored = false, analyzed = false;
  double last = 0;
  while (!solved.converged && solved.steps < most_steps) {
    check_interrupt();
    const bool fresh = !factored;
    entries.clear();
    part.linearize(gradient, fresh ? &entries : nullptr);
    if (fresh) {
      Matrix hessian(3 * part.size(), 3 * part.size());
      hessian.setFromTriplets(entries.begin(), entries.end());
      if (!analyzed) factors.analyzePattern(hessian);
      analyzed = true;
      factors.factorize(hessian);
      factored = true;
    }
    const Vector step = factors.solve(-gradient);
    solved.work += static_cast<double>(part.size()) * (fresh ? 1 : chord_cost);
    ++solved.steps;
    const double size = farthest(step);
    if (!std::isfinite(size)) break;
    const std::vector<Pose2> before = part.poses();
    double taken = 1;
    Part::Sums after;
    for (int halvings = 0;; ++halvings, taken /= 2) {
      part.move(step, taken);
      after = part.sums();
      if (after.cost <= now.cost) break;
      part.put_back(before);
      if (halvings == most_halvings) {
        taken = 0;
        break;
      }
    }
    if (taken > 0) {
      map.squares_m += after.squares_m - now.squares_m;
      map.squares_rad += after.squares_rad - now.squares_rad;
      now = after;
    }
    solved.step_m = taken * size;
    // Where no part of a new step lessens the sum, rounding is all that is left.
    solved.converged = size <= map.config.tolerance || (fresh && taken == 0);
    // Old factors serve on while they halve the step.
    factored = taken == 1 && (fresh || size < last / 2);
    last = size;
  }
  return solved;
}

/// Up to `count` nodes, nearest first by links from those that are due; never node 0, which holds
/// the map in its place.
std::vector<std::int64_t> nodes_around(const MapArrays& map, std::int64_t count) {
  std::unordered_map<std::int64_t, bool> seen;
  std::vector<std::int64_t> found;
  const auto visit = [&](std::int64_t node) {
    if (node != 0 && seen.emplace(node, true).second) found.push_back(node);
  };
  for (const std::int64_t node : map.due) visit(node);
  for (std::size_t i = 0; i < found.size() && static_cast<std::int64_t>(found.size()) < count; ++i)
    map.around(found[i], [&](std::int64_t, std::int64_t other) { visit(other); });
  return found;
}

std::vector<std::int64_t> all_nodes(const MapArrays& map) {
  std::vector<std::int64_t> nodes;
  for (std::int64_t i = 1; i < map.size(); ++i) nodes.push_back(i);
  return nodes;
}

/// The robot stays where it is in the frame of its node.
class RobotOnNode {
 public:
  explicit RobotOnNode(MapArrays& map) : map_(map), heading_(map.nodes[map.current].heading) {}
  ~RobotOnNode() {
    const double turn = map_.nodes[map_.current].heading - heading_;
    if (turn == 0) return;
    const double c = std::cos(turn), s = std::sin(turn), x = map_.dx;
    map_.dx = c * x - s * map_.dy;
    map_.dy = s * x + c * map_.dy;
    map_.facing = wrapped(map_.facing + turn);
  }
  RobotOnNode(const RobotOnNode&) = delete;
  RobotOnNode& operator=(const RobotOnNode&) = delete;

 private:
  MapArrays& map_;
  double heading_;
};

void solve_whole(MapArrays& map, Relaxation& done) {
  Part part(map, all_nodes(map));
  const Solved solved = solve(map, part);
  done.step_m = solved.step_m;
  done.sweeps += solved.steps;
  done.nodes = part.size();
  done.settled = solved.converged;
  map.credit -= solved.work;
  map.local_only = !solved.converged;
  if (solved.converged) map.due.clear();
}

/// Relaxes ever larger surroundings of what is due, until those next to them are at rest or the
/// work that may be done is.
void solve_parts(MapArrays& map, Relaxation& done) {
  for (std::int64_t count = first_part;; count *= part_growth) {
    const auto nodes = nodes_around(map, count);
    if (static_cast<std::int64_t>(nodes.size()) + 1 >= map.size()) {
      solve_whole(map, done);
      return;
    }
    Part part(map, nodes);
    const Solved solved = solve(map, part);
    done.step_m = solved.step_m;
    done.sweeps += solved.steps;
    done.nodes = part.size();
    map.credit -= solved.work;
    if (part.unrest_beside() <= map.config.tolerance) {
      map.due.clear();
      return;
    }
    if (map.credit < static_cast<double>(count * part_growth)) return;
  }
}

}  // namespace

Relaxation relax_by_newton(MapArrays& map, bool whole) {
  Relaxation done;
  const auto size = static_cast<double>(map.size());
  map.credit = std::min(map.credit + map.config.work, most_steps * size);
  if (!map.due.empty() || map.local_only) {
    const RobotOnNode robot(map);
    // Twice the map: one step that needs new factors, and one that tells that it has converged.
    if (whole || (map.local_only && map.credit >= 2 * size))
      solve_whole(map, done);
    else if (!map.due.empty())
      solve_parts(map, done);
    done.settled = map.due.empty() && !map.local_only;
  }
  const double links = std::max<double>(1, static_cast<double>(map.links.size()));
  done.residual_m = std::sqrt(std::max(0.0, map.squares_m) / links);
  done.residual_rad = std::sqrt(std::max(0.0, map.squares_rad) / links);
  return done;
}

}  // namespace fusionslam::detail
