// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "dbscan_groups.hpp"
#include "fusionslam/views/scene.hpp"

namespace fusionslam {
namespace {

constexpr std::int32_t noise = -1;

/// Disjoint sets; the smallest member stands for each.
class Sets {
 public:
  explicit Sets(std::size_t size) : parents_(size) {
    std::iota(parents_.begin(), parents_.end(), 0U);
  }

  std::uint32_t find(std::uint32_t member) {
    while (parents_[member] != member) {
      parents_[member] = parents_[parents_[member]];
      member = parents_[member];
    }
    return member;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = find(a);
    b = find(b);
    parents_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parents_;
};

template <int D>
class Clustering {
 public:
  Clustering(PointsView points, ColorsView colors, const DbscanConfig& config, double bound)
      : groups_(points, colors, config.eps, config.color_scale, bound),
        bound_(bound),
        min_points_(static_cast<std::size_t>(config.min_points)),
        core_(points.size, 0),
        sets_(groups_.size()) {}

  std::vector<std::int32_t> run() {
    const auto enough_points = [&](std::size_t cell) { return near_points(cell) >= min_points_; };
    const auto has_core = [&](std::size_t cell) { return groups_.kept_in(cell) > 0; };
    const auto has_border = [&](std::size_t cell) {
      return groups_.kept_in(cell) < groups_.size_of(cell) && near_points(cell) > 0;
    };
    for_groups(enough_points, [&](std::uint32_t group) { find_core(group); });
    groups_.keep_only(core_);
    for_groups(has_core, [&](std::uint32_t group) { join_close(group); });
    for_groups(has_core, [&](std::uint32_t group) { join_touching(group); });
    number_clusters();
    for_groups(has_border, [&](std::uint32_t group) { label_border(group); });
    return std::move(labels_);
  }

 private:
  using Node = detail::BoxNode<D>;

  /// Points that count in the cell and around it.
  std::size_t near_points(std::size_t cell) const {
    std::size_t sum = 0;
    for (const std::uint32_t near : groups_.neighborhood(cell)) sum += groups_.kept_in(near);
    return sum;
  }

  /// Calls work(group) for the groups of the wanted cells; candidates_ then has the groups with
  /// points that count which may hold neighbours of its points.
  template <class Wanted, class Work>
  void for_groups(Wanted&& wanted, Work&& work) {
    for (std::size_t cell = 0; cell < groups_.cell_count(); ++cell) {
      detail::check_interrupt();
      if (!wanted(cell)) continue;
      find_candidates(cell);
      for (std::uint32_t group = groups_.first_group(cell); group < groups_.end_group(cell);
           ++group)
        work(group);
    }
  }

  void find_candidates(std::size_t cell) {
    candidates_.clear();
    for (const std::uint32_t near : groups_.neighborhood(cell)) {
      if (groups_.kept_in(near) == 0) continue;
      for (std::uint32_t group = groups_.first_group(near); group < groups_.end_group(near);
           ++group)
        if (groups_.group(group).kept > 0) candidates_.push_back(group);
    }
  }

  void find_near(std::uint32_t group) {
    near_.clear();
    const Node& node = groups_.group(group);
    for (const std::uint32_t other : candidates_)
      if (other != group && node.box.least(groups_.group(other).box) <= bound_)
        near_.push_back(other);
  }

  void find_core(std::uint32_t group) {
    const Node& node = groups_.group(group);
    if (node.size() >= min_points_) {
      std::fill(&core_[node.begin], &core_[node.begin] + node.size(), std::uint8_t{1});
      return;
    }
    find_near(group);
    for (std::uint32_t i = node.begin; i < node.end; ++i) core_[i] = is_core(i, node.size());
  }

  bool is_core(std::uint32_t position, std::size_t found) {
    const auto query = groups_.point(position);
    for (const std::uint32_t other : near_) {
      found += groups_.count(groups_.group(other), query.data(), min_points_ - found);
      if (found >= min_points_) return true;
    }
    return false;
  }

  /// Joins groups all of whose members are neighbours: cheap, and saves most of the searches.
  void join_close(std::uint32_t group) {
    const Node& node = groups_.group(group);
    if (node.kept == 0) return;
    for (const std::uint32_t other : candidates_) {
      const Node& second = groups_.group(other);
      if (other > group && node.box.greatest(second.box) <= bound_) sets_.join(group, other);
    }
  }

  void join_touching(std::uint32_t group) {
    const Node& node = groups_.group(group);
    if (node.kept == 0) return;
    for (const std::uint32_t other : candidates_)
      if (other > group && sets_.find(group) != sets_.find(other) &&
          groups_.touch(node, groups_.group(other)))
        sets_.join(group, other);
  }

  /// Numbers the clusters in the order of their first core points.
  void number_clusters() {
    const std::vector<std::uint32_t>& order = groups_.order();
    std::vector<std::uint32_t> set_of(order.size(), none);
    for (std::uint32_t group = 0; group < groups_.size(); ++group)
      for (std::uint32_t i = groups_.group(group).begin; i < groups_.group(group).end; ++i)
        if (core_[i] != 0) set_of[order[i]] = sets_.find(group);
    numbers_.assign(groups_.size(), noise);
    labels_.assign(order.size(), noise);
    std::int32_t next = 0;
    for (std::size_t i = 0; i < order.size(); ++i) {
      if (set_of[i] == none) continue;
      std::int32_t& number = numbers_[set_of[i]];
      if (number == noise) number = next++;
      labels_[i] = number;
    }
  }

  void label_border(std::uint32_t group) {
    const Node& node = groups_.group(group);
    if (node.kept == node.size()) return;
    find_near(group);
    near_.push_back(group);
    for (std::uint32_t i = node.begin; i < node.end; ++i)
      if (core_[i] == 0) labels_[groups_.order()[i]] = first_reaching(groups_.original(i));
  }

  std::int32_t first_reaching(const std::array<double, D>& query) {
    std::int32_t first = noise;
    for (const std::uint32_t other : near_) {
      const Node& node = groups_.group(other);
      const std::int32_t number = numbers_[sets_.find(other)];
      if ((first == noise || number < first) && groups_.count(node, query.data(), 1) > 0)
        first = number;
    }
    return first;
  }

  static constexpr std::uint32_t none = 0xffffffff;

  detail::Groups<D> groups_;
  double bound_;
  std::size_t min_points_;
  std::vector<std::uint8_t> core_;  // by position
  Sets sets_;                       // of groups
  std::vector<std::int32_t> numbers_;
  std::vector<std::int32_t> labels_;
  std::vector<std::uint32_t> candidates_;
  std::vector<std::uint32_t> near_;
};

/// The greatest squared distance of neighbours.
double neighbor_bound(const DbscanConfig& config) {
  const double square = config.eps * config.eps;
  return config.inclusive ? square : std::nextafter(square, 0.0);
}

}  // namespace

std::vector<std::int32_t> dbscan(PointsView points, ColorsView colors, const DbscanConfig& config) {
  validate(config);
  detail::check_points(points, 0, "DBSCAN");
  if (colors.size > 0) detail::check_colors(points, colors);
  if (points.size > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max()))
    throw DataError("the cloud has " + std::to_string(points.size) +
                    " points, DBSCAN takes at most 2^31 - 1");
  if (points.size == 0) return {};
  const double bound = neighbor_bound(config);
  if (colors.size == 0) return Clustering<3>(points, colors, config, bound).run();
  return Clustering<6>(points, colors, config, bound).run();
}

}  // namespace fusionslam
