// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Places and headings of nodes by weighted least squares over links (Gauss-Newton on SE(2), sparse
// LDLT), of the nodes around a change or of the whole map.
#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "../detail/interrupt.hpp"
#include "map_arrays.hpp"
#include "part.hpp"

namespace fusionslam::detail {
namespace {

using Vector = Part::Vector;
// A part numbers its nodes so that few blocks fill up.
using Factors = Eigen::SimplicialLDLT<Part::Matrix, Eigen::Lower, Eigen::NaturalOrdering<int>>;

constexpr std::int64_t first_part = 32;  // nodes that are relaxed around a change at first
constexpr int part_growth = 4;
constexpr int most_steps = 50;
constexpr int most_halvings = 8;
// Cost of a step that reuses the factors of an earlier one.
constexpr double chord_cost = 0.125;
// Cost of one step with new factors and of some that follow; the credit may become negative.
constexpr double whole_cost = 2;
// Part of the map that may be moved per action, so that large maps do not wait longer.
constexpr double work_share = 0.02;
// If nodes beside a part would move farther, the whole map is relaxed at once.
constexpr double urgent_m = 0.01;
// Nodes that would move less wait until the whole map is relaxed.
constexpr double calm_m = 0.001;

/// Result of solving a part.
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

/// Applies the largest fraction tried of a step that reduces the sum, and returns it; 0 if none
/// does.
double move_downhill(Part& part, const Vector& step, Part::Sums& sums) {
  const std::vector<Pose2> before = part.poses();
  double share = 1;
  for (int halvings = 0; halvings <= most_halvings; ++halvings, share /= 2) {
    part.move(step, share);
    const Part::Sums after = part.evaluate();
    if (after.cost <= sums.cost) {
      sums = after;
      return share;
    }
    part.put_back(before);
  }
  part.evaluate();
  return 0;
}

/// The solution where factors would take too long, as near as a bounded number of steps comes.
Vector solve_without_factors(const Part::Matrix& hessian, const Vector& right) {
  constexpr int rounds = 10, steps_a_round = 50;
  Eigen::ConjugateGradient<Part::Matrix, Eigen::Lower> solver(hessian);
  solver.setMaxIterations(steps_a_round);
  Vector found = Vector::Zero(right.size());
  for (int round = 0; round < rounds; ++round) {
    check_interrupt();
    found = solver.solveWithGuess(right, found);
    if (solver.info() == Eigen::Success) break;
  }
  return found;
}

/// Gauss-Newton steps, each made shorter until it lessens the sum; factors serve as long as they
/// bring the map nearer quickly.
Solved solve(MapArrays& map, Part& part) {
  Solved solved;
  Factors factors;
  Part::Matrix hessian;
  Vector gradient;
  Part::Sums sums = part.evaluate();
  const bool direct = part.has_sparse_factors();
  bool factored = false;
  double last = 0;
  while (!solved.converged && solved.steps < most_steps) {
    check_interrupt();
    const bool fresh = !factored;
    part.linearize(gradient, fresh ? &hessian : nullptr);
    if (fresh && direct) {
      if (solved.steps == 0) factors.analyzePattern(hessian);
      factors.factorize(hessian);
    }
    const Vector step =
        direct ? Vector(factors.solve(-gradient)) : solve_without_factors(hessian, -gradient);
    solved.work += static_cast<double>(part.size()) * (fresh ? 1 : chord_cost);
    ++solved.steps;
    const double size = farthest(step);
    if (!std::isfinite(size)) break;
    const Part::Sums before = sums;
    const double share = move_downhill(part, step, sums);
    map.squares_m += sums.squares_m - before.squares_m;
    map.squares_rad += sums.squares_rad - before.squares_rad;
    solved.step_m = share * size;
    // If no fraction of a new step reduces the sum, only rounding is left.
    solved.converged = size <= map.config.tolerance || (fresh && share == 0);
    // Old factors are reused while they halve the step.
    factored = direct && share == 1 && (fresh || size < last / 2);
    last = size;
  }
  return solved;
}

/// Up to `count` nodes, nearest first by links from those that are due; never node 0, which holds
/// the map in its place.
std::vector<std::int64_t> nodes_around(MapArrays& map, std::int64_t count) {
  map.rows.resize(map.nodes.size(), -1);
  std::vector<std::int64_t> found;
  const auto visit = [&](std::int64_t node) {
    if (node == 0 || map.rows[node] >= 0) return;
    map.rows[node] = 0;
    found.push_back(node);
  };
  for (const std::int64_t node : map.due) visit(node);
  for (std::size_t i = 0; i < found.size() && static_cast<std::int64_t>(found.size()) < count; ++i)
    map.around(found[i], [&](std::int64_t, std::int64_t other) { visit(other); });
  for (const std::int64_t node : found) map.rows[node] = -1;
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
    map_.facing = wrap_angle(map_.facing + turn);
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

/// Relaxes growing surroundings of the nodes that are due, until the nodes next to them are at rest
/// or the work is used up. The whole map takes the rest later, or at once if that is much.
void solve_parts(MapArrays& map, Relaxation& done) {
  if (std::all_of(map.due.begin(), map.due.end(), [&](std::int64_t node) {
        check_interrupt();
        return unrest(map, node) <= calm_m;
      })) {
    map.due.clear();
    return;
  }
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
    const double unrest = part.unrest_beside();
    if (unrest > urgent_m && map.credit > 0) {
      solve_whole(map, done);
      return;
    }
    if (unrest <= map.config.tolerance || map.credit < static_cast<double>(count * part_growth)) {
      map.due.clear();
      return;
    }
  }
}

}  // namespace

Relaxation relax_by_newton(MapArrays& map, bool whole) {
  Relaxation done;
  const auto size = static_cast<double>(map.size());
  map.credit = std::min(map.credit + map.config.work + work_share * size, most_steps * size);
  if (!map.due.empty() || map.local_only) {
    const RobotOnNode robot(map);
    const bool ready = map.local_only && map.credit >= whole_cost * size;
    // Until the whole is at rest, also where the work is interrupted.
    map.local_only = true;
    if (whole || ready)
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
