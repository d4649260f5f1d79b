// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "part.hpp"

#include <Eigen/OrderingMethods>
#include <algorithm>
#include <cmath>
#include <utility>

#include "../detail/interrupt.hpp"

namespace fusionslam::detail {
namespace {

double square_of_place(const Pose2& error) { return error.x * error.x + error.y * error.y; }

/// Squared error over variance.
double weigh(const Link& link, const Pose2& error) {
  return square_of_place(error) / link.measure.variance_m +
         error.heading * error.heading / link.measure.variance_rad;
}

/// Factor on a link's pull (Huber): only loops may be wrong.
double trust(const Link& link, double square, double limit) {
  return link.loop && square > limit * limit ? limit / std::sqrt(square) : 1;
}

}  // namespace

double unrest(const MapArrays& map, std::int64_t node) {
  double x = 0, y = 0, stiffness = 0;
  map.around(node, [&](std::int64_t number, std::int64_t) {
    const Link& link = map.links[number];
    const Pose2 error = link_error(map, link);
    const double weight =
        trust(link, weigh(link, error), map.config.outlier) / link.measure.variance_m;
    const double sign = link.source == node ? -1 : 1;
    x += sign * weight * error.x, y += sign * weight * error.y;
    stiffness += weight;
  });
  return stiffness > 0 ? std::hypot(x, y) / stiffness : 0;
}

Part::Part(MapArrays& map, std::vector<std::int64_t> nodes) : map_(map), nodes_(std::move(nodes)) {
  map_.rows.resize(map_.nodes.size(), -1);
  for (std::size_t i = 0; i < nodes_.size(); ++i) map_.rows[nodes_[i]] = static_cast<int>(i);
  collect_links();
  order_nodes();
  lay_out();
}

Part::~Part() {
  for (const std::int64_t node : nodes_) map_.rows[node] = -1;
}

void Part::collect_links() {
  for (const std::int64_t node : nodes_)
    map_.around(node, [&](std::int64_t number, std::int64_t other) {
      // Once, where both ends are in the part.
      if (row(other) < 0 || map_.links[number].source == node)
        links_.push_back({number, 0, 0, 0, {}, 0, 0, 1});
    });
}

/// Numbers the nodes such that few blocks fill up (approximate minimum degree).
void Part::order_nodes() {
  using Entry = Eigen::Triplet<signed char>;
  std::vector<Entry> entries;
  for (int i = 0; i < size(); ++i) entries.emplace_back(i, i, 1);
  for (const PartLink& link : links_) {
    const int from = row(map_.links[link.number].source), to = row(map_.links[link.number].target);
    if (from >= 0 && to >= 0) entries.emplace_back(std::max(from, to), std::min(from, to), 1);
  }
  Eigen::SparseMatrix<signed char> pattern(size(), size());
  pattern.setFromTriplets(entries.begin(), entries.end(),
                          [](signed char one, signed char) { return one; });
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
  Eigen::AMDOrdering<int>()(pattern.selfadjointView<Eigen::Lower>(), order);
  std::vector<std::int64_t> ordered(nodes_.size());
  for (int i = 0; i < size(); ++i) ordered[i] = nodes_[order.indices()[i]];
  nodes_ = std::move(ordered);
  for (std::size_t i = 0; i < nodes_.size(); ++i) map_.rows[nodes_[i]] = static_cast<int>(i);
}

/// Finds the neighbours of higher number of each node, and the slot of each link among them.
void Part::lay_out() {
  const auto pair = [](const PartLink& link) {
    return std::pair{std::min(link.from, link.to), std::max(link.from, link.to)};
  };
  std::vector<std::pair<int, int>> pairs;
  for (PartLink& link : links_) {
    link.from = row(map_.links[link.number].source);
    link.to = row(map_.links[link.number].target);
    if (pair(link).first >= 0) pairs.push_back(pair(link));
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  first_.assign(nodes_.size() + 1, 0);
  for (const auto& [low, high] : pairs) ++first_[low + 1], beside_.push_back(high);
  for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
  for (PartLink& link : links_) {
    if (pair(link).first < 0) continue;
    const auto found = std::lower_bound(pairs.begin(), pairs.end(), pair(link));
    link.slot = static_cast<int>(found - pairs.begin()) - first_[found->first];
  }
}

Part::Sums Part::evaluate() {
  Sums sums;
  for (PartLink& part : links_) {
    const Link& link = map_.links[part.number];
    const Pose2 &from = map_.nodes[link.source], &to = map_.nodes[link.target];
    const double way = from.heading + link.measure.heading;
    const double x = link.measure.distance * std::cos(way);
    const double y = link.measure.distance * std::sin(way);
    part.error = {to.x - from.x - x, to.y - from.y - y,
                  wrap_angle(to.heading - from.heading - link.measure.facing)};
    part.turn_x = y, part.turn_y = -x;
    const double square = weigh(link, part.error);
    part.weight = trust(link, square, map_.config.outlier);
    sums.squares_m += square_of_place(part.error);
    sums.squares_rad += part.error.heading * part.error.heading;
    // Beyond the limit l: l (2 sqrt(square) - l).
    sums.cost += part.weight * (2 - part.weight) * square;
  }
  return sums;
}

void Part::linearize(Vector& gradient, Matrix* hessian) const {
  gradient.setZero(3 * size());
  if (hessian && hessian->rows() == 0) shape(*hessian);
  if (hessian) std::fill_n(hessian->valuePtr(), hessian->nonZeros(), 0);
  for (const PartLink& link : links_) {
    const Measure& measure = map_.links[link.number].measure;
    const double place = link.weight / measure.variance_m;
    const double rotation = link.weight / measure.variance_rad;
    add_gradient(link, place, rotation, gradient);
    if (hessian) add_blocks(link, place, rotation, hessian->valuePtr());
  }
}

void Part::add_gradient(const PartLink& link, double place, double rotation,
                        Vector& gradient) const {
  const Pose2& error = link.error;
  if (link.from >= 0) {
    double* values = &gradient[3 * link.from];
    values[0] -= place * error.x;
    values[1] -= place * error.y;
    values[2] += place * (link.turn_x * error.x + link.turn_y * error.y) - rotation * error.heading;
  }
  if (link.to >= 0) {
    double* values = &gradient[3 * link.to];
    values[0] += place * error.x;
    values[1] += place * error.y;
    values[2] += rotation * error.heading;
  }
}

/// Start of a column of the Hessian's lower triangle: 6 values of each node's own block in
/// three columns, and 3 of each block below.
int Part::column(int number, int axis) const {
  const int own = axis == 0 ? 0 : axis == 1 ? 3 : 5;
  return 6 * number + 9 * first_[number] + own + 3 * axis * (first_[number + 1] - first_[number]);
}

void Part::shape(Matrix& hessian) const {
  const int count = static_cast<int>(size());
  hessian.resize(3 * count, 3 * count);
  const int entries = 6 * count + 9 * static_cast<int>(beside_.size());
  hessian.resizeNonZeros(entries);
  for (int i = 0; i < count; ++i)
    for (int axis = 0; axis < 3; ++axis) {
      hessian.outerIndexPtr()[3 * i + axis] = column(i, axis);
      int* row = hessian.innerIndexPtr() + column(i, axis);
      for (int below = axis; below < 3; ++below) *row++ = 3 * i + below;
      for (int slot = first_[i]; slot < first_[i + 1]; ++slot)
        for (int below = 0; below < 3; ++below) *row++ = 3 * beside_[slot] + below;
    }
  hessian.outerIndexPtr()[3 * count] = entries;
}

void Part::add_blocks(const PartLink& link, double place, double rotation, double* values) const {
  const double x = place * link.turn_x, y = place * link.turn_y;
  for (const int end : {link.from, link.to}) {
    if (end < 0) continue;
    values[column(end, 0)] += place;
    values[column(end, 1)] += place;
    values[column(end, 2)] += rotation;
  }
  if (link.from >= 0) {
    values[column(link.from, 0) + 2] -= x;
    values[column(link.from, 1) + 1] -= y;
    values[column(link.from, 2)] += x * link.turn_x + y * link.turn_y;
  }
  if (link.from < 0 || link.to < 0) return;
  const int low = std::min(link.from, link.to);
  double* block[3];
  for (int axis = 0; axis < 3; ++axis)
    block[axis] = values + column(low, axis) + (3 - axis) + 3 * link.slot;
  block[0][0] -= place;
  block[1][1] -= place;
  block[2][2] -= rotation;
  // The source's heading moves where the target is expected.
  if (low == link.from)
    block[2][0] += x, block[2][1] += y;
  else
    block[0][2] += x, block[1][2] += y;
}

bool Part::has_sparse_factors() const {
  constexpr double most_work = 1e10;  // multiplications
  constexpr std::int64_t most_blocks = 10'000'000;
  constexpr double work_of_block = 27;
  constexpr std::int64_t few = 500;  // nodes, whose factors are small even if they are full
  if (size() <= few) return true;
  const auto count = static_cast<std::size_t>(size());
  std::vector<std::vector<int>> lower(count);
  for (std::size_t i = 0; i < count; ++i)
    for (int slot = first_[i]; slot < first_[i + 1]; ++slot)
      lower[static_cast<std::size_t>(beside_[slot])].push_back(static_cast<int>(i));
  // Blocks of each column by walks along the elimination tree (Liu 1986).
  std::vector<int> parent(count, -1), reached(count, -1);
  std::vector<std::int64_t> blocks(count);
  std::int64_t total = 0;
  for (std::size_t row = 0; row < count; ++row) {
    const int here = static_cast<int>(row);
    reached[row] = here;
    for (int column : lower[row])
      for (; reached[column] != here; column = parent[column]) {
        if (parent[column] < 0) parent[column] = here;
        reached[column] = here;
        ++blocks[column];
        if (++total > most_blocks) return false;
      }
  }
  double work = 0;
  for (const std::int64_t number : blocks)
    work += work_of_block * static_cast<double>(number) * static_cast<double>(number);
  return work <= most_work;
}

void Part::move(const Vector& step, double share) {
  for (std::int64_t i = 0; i < size(); ++i) {
    Pose2& node = map_.nodes[nodes_[i]];
    node.x += share * step[3 * i];
    node.y += share * step[3 * i + 1];
    node.heading = wrap_angle(node.heading + share * step[3 * i + 2]);
  }
}

std::vector<Pose2> Part::poses() const {
  std::vector<Pose2> poses;
  poses.reserve(nodes_.size());
  for (const std::int64_t node : nodes_) poses.push_back(map_.nodes[node]);
  return poses;
}

void Part::put_back(const std::vector<Pose2>& poses) {
  for (std::size_t i = 0; i < nodes_.size(); ++i) map_.nodes[nodes_[i]] = poses[i];
}

double Part::unrest_beside() const {
  double farthest = 0;
  for (const std::int64_t inside : nodes_)
    map_.around(inside, [&](std::int64_t, std::int64_t other) {
      check_interrupt();
      if (row(other) < 0 && other != 0) farthest = std::max(farthest, unrest(map_, other));
    });
  return farthest;
}

}  // namespace fusionslam::detail
