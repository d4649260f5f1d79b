// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The points of DBSCAN as groups whose members are all neighbours of each other (after Gunawan
// 2013): a group of min_points members is core as a whole, and one pair joins two groups.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "../detail/cell_table.hpp"
#include "dbscan_kernel.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

/// Bounds of points in D dimensions. Distances to it are rounded as those to its points are, so
/// they bound these exactly.
template <int D>
struct Box {
  std::array<double, D> low, high;

  double least(const double* point) const {
    double squares = 0;
    for (std::size_t d = 0; d < D; ++d) {
      const double away = std::max({low[d] - point[d], point[d] - high[d], 0.0});
      squares += away * away;
    }
    return squares;
  }
  double greatest(const double* point) const {
    double squares = 0;
    for (std::size_t d = 0; d < D; ++d) {
      const double away = std::max(high[d] - point[d], point[d] - low[d]);
      squares += away * away;
    }
    return squares;
  }
  double least(const Box& other) const {
    double squares = 0;
    for (std::size_t d = 0; d < D; ++d) {
      const double away = std::max({low[d] - other.high[d], other.low[d] - high[d], 0.0});
      squares += away * away;
    }
    return squares;
  }
  double greatest(const Box& other) const {
    double squares = 0;
    for (std::size_t d = 0; d < D; ++d) {
      const double away = std::max(high[d] - other.low[d], other.high[d] - low[d]);
      squares += away * away;
    }
    return squares;
  }
};

/// Points `begin` to `end` of the sorted ones; two halves unless it is a leaf.
template <int D>
struct BoxNode {
  Box<D> box;
  std::uint32_t begin, end;
  std::uint32_t kept = 0;             ///< how many of its points count
  std::uint32_t left = 0, right = 0;  ///< nodes; 0, a node that is nobody's child, in a leaf

  bool is_leaf() const { return left == 0; }
  std::uint32_t size() const { return end - begin; }
};

/// A grid of cells, in each of them groups, in each group a tree of boxes.
template <int D>
class Groups {
 public:
  /// `bound`: the greatest squared distance of neighbours; eps >= its root.
  Groups(PointsView points, ColorsView colors, double eps, double color_scale, double bound);

  std::size_t size() const { return roots_.size(); }
  std::size_t point_count() const { return order_.size(); }
  const BoxNode<D>& group(std::size_t number) const { return nodes_[roots_[number]]; }
  std::size_t cell_count() const { return cells_.size(); }
  std::uint32_t first_group(std::size_t cell) const { return first_groups_[cell]; }
  std::uint32_t end_group(std::size_t cell) const { return first_groups_[cell + 1]; }

  /// Number of points of the cell that count, and of all of them.
  std::uint32_t kept_in(std::size_t cell) const { return kept_in_cells_[cell]; }
  std::uint32_t size_of(std::size_t cell) const {
    return first_points_[cell + 1] - first_points_[cell];
  }
  const std::vector<std::uint32_t>& order() const { return order_; }  ///< input index of each point

  std::array<double, D> point(std::size_t position) const {
    std::array<double, D> result;
    for (std::size_t d = 0; d < D; ++d) result[d] = columns_[d * point_count() + position];
    return result;
  }

  /// The point at a position, whether it counts or not.
  std::array<double, D> original(std::size_t position) const {
    std::array<double, D> result = point(position);
    result[0] = kept_x_.empty() ? result[0] : kept_x_[position];
    return result;
  }

  /// The cell and its neighbours, which hold every neighbour of the cell's points.
  std::span<const std::uint32_t> neighborhood(std::size_t cell) const {
    return cells_.neighborhood(cell);
  }

  /// Number of points of the node that count and are neighbours of `query`; stops at `enough`.
  std::size_t count(const BoxNode<D>& node, const double* query, std::size_t enough) const;

  /// True if a point of one node is a neighbour of one of the other; both must count.
  bool touch(const BoxNode<D>& a, const BoxNode<D>& b) const;

  /// Lets only points with `keep`, by position, count from now on.
  void keep_only(const std::vector<std::uint8_t>& keep);

 private:
  void sort_by_cell(PointsView points);
  void copy_rows(PointsView points, ColorsView colors, double color_scale);
  std::uint32_t build(std::uint32_t begin, std::uint32_t end, bool in_group);
  std::uint32_t split(const Box<D>& box, std::uint32_t begin, std::uint32_t end);
  void copy_columns();
  std::size_t scan(const BoxNode<D>& leaf, const double* query) const {
    return kernel_(columns_.data() + leaf.begin, point_count(), leaf.size(), query, bound_);
  }

  double bound_;
  CellTable cells_;
  CountWithin* kernel_;
  std::vector<std::uint32_t> order_;
  std::vector<std::uint32_t> first_points_;  // of each cell
  std::vector<std::uint32_t> kept_in_cells_;
  std::vector<std::uint32_t> first_groups_;
  std::vector<std::uint32_t> roots_;
  std::vector<BoxNode<D>> nodes_;
  std::vector<std::array<double, D>> rows_;  // sorted points, while the groups are made
  std::vector<double> columns_;
  std::vector<double> kept_x_;  // the first column before some values became infinite
};

}  // namespace fusionslam::detail
