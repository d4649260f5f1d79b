// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "dbscan_groups.hpp"

#include <limits>
#include <utility>

#include "../detail/interrupt.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::uint32_t leaf_size = 32;
/// Cells are a little wider than eps: a rounded quotient must not put neighbours two cells apart.
constexpr double cell_margin = 1 + 1e-6;

template <int D>
Box<D> bounds(const std::array<double, D>* rows, std::size_t size) {
  Box<D> box{rows[0], rows[0]};
  for (std::size_t i = 1; i < size; ++i)
    for (std::size_t d = 0; d < D; ++d) {
      box.low[d] = std::min(box.low[d], rows[i][d]);
      box.high[d] = std::max(box.high[d], rows[i][d]);
    }
  return box;
}

}  // namespace

template <int D>
Groups<D>::Groups(PointsView points, ColorsView colors, double eps, double color_scale,
                  double bound)
    : bound_(bound),
      cells_(eps * cell_margin, points.size),
      kernel_(count_within(D, simd_level())) {
  sort_by_cell(points);
  cells_.link();
  copy_rows(points, colors, color_scale);
  nodes_.emplace_back();  // the 0 of leaves
  for (std::size_t cell = 0; cell < cells_.size(); ++cell) {
    check_interrupt();
    first_groups_.push_back(static_cast<std::uint32_t>(roots_.size()));
    build(first_points_[cell], first_points_[cell + 1], false);
    kept_in_cells_.push_back(size_of(cell));
  }
  first_groups_.push_back(static_cast<std::uint32_t>(roots_.size()));
  copy_columns();
}

template <int D>
void Groups<D>::sort_by_cell(PointsView points) {
  std::vector<std::uint32_t> cell_of(points.size);
  first_points_.assign(1, 0);
  for (std::size_t i = 0; i < points.size; ++i) {
    cell_of[i] = cells_.insert(points[i]);
    if (cells_.size() + 1 > first_points_.size()) first_points_.push_back(0);
    ++first_points_[cell_of[i] + 1];
  }
  for (std::size_t c = 1; c < first_points_.size(); ++c) first_points_[c] += first_points_[c - 1];
  std::vector<std::uint32_t> next(first_points_);
  order_.resize(points.size);
  for (std::size_t i = 0; i < points.size; ++i)
    order_[next[cell_of[i]]++] = static_cast<std::uint32_t>(i);
}

template <int D>
void Groups<D>::copy_rows(PointsView points, ColorsView colors, double color_scale) {
  rows_.resize(points.size);
  for (std::size_t i = 0; i < points.size; ++i) {
    const float* point = points[order_[i]];
    for (std::size_t d = 0; d < 3; ++d) rows_[i][d] = static_cast<double>(point[d]);
    if constexpr (D == 6)
      for (std::size_t d = 0; d < 3; ++d)
        rows_[i][3 + d] = color_scale * colors.at(order_[i], static_cast<int>(d));
  }
}

/// The tree of some points of a cell. Its topmost nodes that are narrow enough become groups.
template <int D>
std::uint32_t Groups<D>::build(std::uint32_t begin, std::uint32_t end, bool in_group) {
  const Box<D> box = bounds<D>(&rows_[begin], end - begin);
  const double diagonal = box.greatest(box);
  const bool is_group = !in_group && diagonal <= bound_;
  const bool is_leaf = (in_group || is_group) && (end - begin <= leaf_size || diagonal == 0);
  std::uint32_t number = 0;
  if (in_group || is_group) {  // nobody asks for the nodes above the groups
    number = static_cast<std::uint32_t>(nodes_.size());
    nodes_.push_back({box, begin, end, end - begin});
    if (is_group) roots_.push_back(number);
    if (is_leaf) return number;
  }
  const std::uint32_t middle = split(box, begin, end);
  const std::uint32_t left = build(begin, middle, in_group || is_group);
  const std::uint32_t right = build(middle, end, in_group || is_group);
  if (number != 0) {
    nodes_[number].left = left;
    nodes_[number].right = right;
  }
  return number;
}

/// Halves the box where it is widest; both halves have points.
template <int D>
std::uint32_t Groups<D>::split(const Box<D>& box, std::uint32_t begin, std::uint32_t end) {
  std::size_t widest = 0;
  for (std::size_t d = 1; d < D; ++d)
    if (box.high[d] - box.low[d] > box.high[widest] - box.low[widest]) widest = d;
  double middle = box.low[widest] + (box.high[widest] - box.low[widest]) / 2;
  if (middle >= box.high[widest]) middle = box.low[widest];
  std::uint32_t i = begin, j = end;
  while (i < j) {
    if (rows_[i][widest] <= middle) {
      ++i;
    } else {
      --j;
      std::swap(rows_[i], rows_[j]);
      std::swap(order_[i], order_[j]);
    }
  }
  return i;
}

template <int D>
void Groups<D>::copy_columns() {
  columns_.resize(D * point_count());
  for (std::size_t d = 0; d < D; ++d)
    for (std::size_t i = 0; i < point_count(); ++i) columns_[d * point_count() + i] = rows_[i][d];
  rows_ = {};
}

template <int D>
std::size_t Groups<D>::count(const BoxNode<D>& node, const double* query,
                             std::size_t enough) const {
  if (node.kept == 0 || node.box.least(query) > bound_) return 0;
  if (node.box.greatest(query) <= bound_) return node.kept;
  if (node.is_leaf()) return scan(node, query);
  const std::size_t left = count(nodes_[node.left], query, enough);
  if (left >= enough) return left;
  return left + count(nodes_[node.right], query, enough - left);
}

template <int D>
bool Groups<D>::touch(const BoxNode<D>& a, const BoxNode<D>& b) const {
  if (a.kept == 0 || b.kept == 0 || a.box.least(b.box) > bound_) return false;
  if (a.box.greatest(b.box) <= bound_) return true;
  if (a.is_leaf() && b.is_leaf()) {
    for (std::uint32_t i = a.begin; i < a.end; ++i) {
      const std::array<double, D> query = point(i);
      if (b.box.least(query.data()) <= bound_ && scan(b, query.data()) > 0) return true;
    }
    return false;
  }
  if (b.is_leaf() || (!a.is_leaf() && a.size() > b.size()))
    return touch(nodes_[a.left], b) || touch(nodes_[a.right], b);
  return touch(a, nodes_[b.left]) || touch(a, nodes_[b.right]);
}

template <int D>
void Groups<D>::keep_only(const std::vector<std::uint8_t>& keep) {
  kept_x_.assign(columns_.begin(), columns_.begin() + static_cast<std::ptrdiff_t>(keep.size()));
  std::vector<std::uint32_t> kept_before(keep.size() + 1, 0);
  for (std::size_t i = 0; i < keep.size(); ++i) {
    kept_before[i + 1] = kept_before[i] + keep[i];
    if (keep[i] == 0) columns_[i] = std::numeric_limits<double>::infinity();
  }
  for (BoxNode<D>& node : nodes_) node.kept = kept_before[node.end] - kept_before[node.begin];
  for (std::size_t cell = 0; cell < cell_count(); ++cell)
    kept_in_cells_[cell] = kept_before[first_points_[cell + 1]] - kept_before[first_points_[cell]];
}

template class Groups<3>;
template class Groups<6>;

}  // namespace fusionslam::detail
