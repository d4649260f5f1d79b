// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "direction_kernel.hpp"
#include "fusionslam/registration.hpp"
#include "rigid.hpp"

namespace fusionslam {
namespace {

using detail::DirectionBlock;
using detail::DirectionGrid;

constexpr double least_step = 0.1, most_step = 30;  // deg
constexpr double most_distance = 100;               // m
constexpr int hole_deg = 10;  // columns without points are no end of the view if they are fewer

/// Calls visit(block, size) for all points, moved and with their directions.
template <class Visit>
void for_each_block(PointsView points, const DirectionGrid& grid, Visit&& visit) {
  const auto find = detail::direction_kernel(simd_level());
  const detail::RawPoints raw{points.data, points.stride, points.size};
  DirectionBlock block;
  for (std::size_t begin = 0; begin < points.size;) {
    detail::check_interrupt();
    const std::size_t size = find(raw, begin, grid, block);
    visit(block, size);
    begin += size;
  }
}

DirectionGrid grid_of(const Transform& motion, int rows, int columns) {
  DirectionGrid grid{{}, rows, columns};
  std::transform(motion.begin(), motion.begin() + 12, grid.motion,
                 [](double value) { return static_cast<float>(value); });
  return grid;
}

/// Points sorted by cubes, to find whether one lies near a place.
class NearTable {
 public:
  NearTable(PointsView points, float distance) : distance_(distance) {
    points_.reserve(points.size);
    for (std::size_t i = 0; i < points.size; ++i)
      points_.push_back(
          {key_of(cell_of(points[i][0]), cell_of(points[i][1]), cell_of(points[i][2])),
           {points[i][0], points[i][1], points[i][2]}});
    std::sort(points_.begin(), points_.end());
    firsts_.assign(std::bit_ceil(2 * points_.size() + 1), none);
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const std::uint64_t column = points_[i].first >> z_bits;
      if (i == 0 || column != points_[i - 1].first >> z_bits)
        firsts_[slot_of(column)] = static_cast<std::uint32_t>(i);
    }
  }

  bool has(const std::array<float, 3>& place) const {
    const std::int64_t x = cell_of(place[0]), y = cell_of(place[1]), z = cell_of(place[2]);
    if (column_has(key_of(x, y, z - 1), key_of(x, y, z + 1), place)) return true;  // most often
    for (std::int64_t i = x - 1; i <= x + 1; ++i)
      for (std::int64_t j = y - 1; j <= y + 1; ++j)
        if (column_has(key_of(i, j, z - 1), key_of(i, j, z + 1), place)) return true;
    return false;
  }

 private:
  using Entry = std::pair<std::uint64_t, std::array<float, 3>>;

  static constexpr std::int64_t half = 1 << 20;  // cubes in each direction; beyond, they share one
  static constexpr int z_bits = 21;
  static constexpr std::uint32_t none = 0xffffffff;

  std::int64_t cell_of(float coordinate) const {
    const double cell =
        std::floor(static_cast<double>(coordinate) / static_cast<double>(distance_));
    constexpr double last = half - 2.0;  // its neighbours have keys, too
    return static_cast<std::int64_t>(cell > -last ? std::min(cell, last) : -last);  // NaN: -last
  }
  static std::uint64_t key_of(std::int64_t x, std::int64_t y, std::int64_t z) {
    return static_cast<std::uint64_t>((x + half) << 2 * z_bits | (y + half) << z_bits |
                                      (z + half));
  }
  /// Slot of a column of cubes above each other, or the one that it would get.
  std::size_t slot_of(std::uint64_t column) const {
    const std::size_t mask = firsts_.size() - 1;
    std::size_t slot = column * 0x9e3779b97f4a7c15ULL >> 32 & mask;
    while (firsts_[slot] != none && points_[firsts_[slot]].first >> z_bits != column)
      slot = (slot + 1) & mask;
    return slot;
  }
  /// Cubes above each other have successive keys.
  bool column_has(std::uint64_t first, std::uint64_t last, const std::array<float, 3>& p) const {
    const std::size_t begin = firsts_[slot_of(first >> z_bits)];
    for (std::size_t i = begin; i < points_.size() && points_[i].first <= last; ++i) {
      if (points_[i].first < first) continue;
      const auto& q = points_[i].second;
      const float x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
      if (x * x + y * y + z * z <= distance_ * distance_) return true;
    }
    return false;
  }

  float distance_;
  std::vector<Entry> points_;
  std::vector<std::uint32_t> firsts_;  // of each column, in points_
};

/// What a sensor saw: its nearest ranges about a direction, and the limits of its view.
class View {
 public:
  explicit View(const NearestRanges& seen) : seen_(seen) {
    std::vector<bool> used(static_cast<std::size_t>(seen.columns), false);
    first_row_ = seen.rows;
    for (int row = 0; row < seen.rows; ++row)
      for (int column = 0; column < seen.columns; ++column) {
        const float range = at(row, column);
        if (!(range > 0)) continue;
        used[static_cast<std::size_t>(column)] = true;
        first_row_ = std::min(first_row_, row);
        last_row_ = row;
        reach_ = std::max(reach_, range);
      }
    find_columns(used);
  }

  bool contains(int cell, float range) const {
    const int row = cell / seen_.columns, column = cell % seen_.columns;
    return row >= first_row_ && row <= last_row_ && range <= reach_ &&
           in_view_[static_cast<std::size_t>(column)];
  }

  /// The nearest range in the direction of the cell and the eight about it; 0 if there is none.
  float nearest(int cell) const {
    const int row = cell / seen_.columns, column = cell % seen_.columns;
    float nearest = 0;
    for (int r = std::max(0, row - 1); r <= std::min(seen_.rows - 1, row + 1); ++r)
      for (int c = column - 1; c <= column + 1; ++c) {
        const float range = at(r, (c + seen_.columns) % seen_.columns);
        if (range > 0 && (nearest == 0 || range < nearest)) nearest = range;
      }
    return nearest;
  }

 private:
  float at(int row, int column) const {
    return seen_.ranges[static_cast<std::size_t>(row * seen_.columns + column)];
  }

  /// All columns but wide gaps between used ones.
  void find_columns(const std::vector<bool>& used) {
    const std::size_t columns = used.size();
    in_view_.assign(columns, true);
    const std::size_t hole = columns * hole_deg / 360;
    for (std::size_t i = 0; i < columns; ++i) {
      if (used[i] || !used[(i + columns - 1) % columns]) continue;
      std::size_t gap = 1;
      while (!used[(i + gap) % columns]) ++gap;
      for (std::size_t k = 0; gap > hole && k < gap; ++k) in_view_[(i + k) % columns] = false;
    }
  }

  const NearestRanges& seen_;
  int first_row_ = 0, last_row_ = -1;
  float reach_ = 0;
  std::vector<bool> in_view_;
};

/// outer * inner.
Transform compose(const Transform& outer, const Transform& inner) {
  Transform product{};
  for (std::size_t row = 0; row < 4; ++row)
    for (std::size_t column = 0; column < 4; ++column)
      for (std::size_t k = 0; k < 4; ++k)
        product[4 * row + column] += outer[4 * row + k] * inner[4 * k + column];
  return product;
}

void check_input(const NearestRanges& seen, const Transform& motion, double distance) {
  if (!(distance > 0 && distance <= most_distance))
    throw ConfigError("distance is " + std::to_string(distance) + ", expected up to 100 m, not 0");
  if (seen.rows < 1 || seen.columns < 1 ||
      seen.ranges.size() !=
          static_cast<std::size_t>(seen.rows) * static_cast<std::size_t>(seen.columns))
    throw ShapeError("ranges: " + std::to_string(seen.ranges.size()) + " values in " +
                     std::to_string(seen.rows) + " x " + std::to_string(seen.columns) + " cells");
  for (std::size_t i = 0; i < seen.ranges.size(); ++i)
    if (!(seen.ranges[i] >= 0 && std::isfinite(seen.ranges[i])))
      throw DataError("range " + std::to_string(i) + " is " + std::to_string(seen.ranges[i]) +
                      ", expected finite metres, 0 where there is no point");
  if (!detail::is_rigid(motion)) throw DataError("the transform is no rigid motion");
}

}  // namespace

NearestRanges nearest_ranges(PointsView points, double step) {
  if (!(step >= least_step && step <= most_step))
    throw ConfigError("step is " + std::to_string(step) + " deg, expected 0.1 to 30");
  detail::check_points(points, 0, "a range image");
  NearestRanges nearest;
  nearest.rows = static_cast<int>(std::lround(180 / step));
  nearest.columns = 2 * nearest.rows;
  nearest.ranges.assign(static_cast<std::size_t>(nearest.rows * nearest.columns), 0);
  const DirectionGrid grid = grid_of(identity_transform, nearest.rows, nearest.columns);
  for_each_block(points, grid, [&](const DirectionBlock& block, std::size_t size) {
    for (std::size_t i = 0; i < size; ++i) {
      float& range = nearest.ranges[static_cast<std::size_t>(block.cell[i])];
      if (block.range[i] > 0 && (range == 0 || block.range[i] < range)) range = block.range[i];
    }
  });
  return nearest;
}

OverlapCounts count_overlap(PointsView points, PointsView other, const NearestRanges& seen,
                            const Transform& other_from_points, double distance) {
  const SensorView view{seen, identity_transform};
  return count_overlap(points, other, {&view, 1}, other_from_points, distance);
}

OverlapCounts count_overlap(PointsView points, PointsView other, std::span<const SensorView> views,
                            const Transform& other_from_points, double distance) {
  if (views.empty()) throw ShapeError("views: none, expected one or more");
  for (const SensorView& view : views) {
    check_input(view.seen, other_from_points, distance);
    if (!detail::is_rigid(view.view_from_cloud))
      throw DataError("a view's transform is no rigid motion");
  }
  detail::check_points(points, 0, "the overlap");
  detail::check_points(other, 0, "the overlap");
  const auto near = static_cast<float>(distance);
  const NearTable others(other, near);
  enum class Fate : std::uint8_t { outside, open, behind, before, agreeing };
  std::vector<Fate> fates(points.size, Fate::outside);
  Fate* fate = fates.data();
  for_each_block(points, grid_of(other_from_points, views[0].seen.rows, views[0].seen.columns),
                 [&](const DirectionBlock& block, std::size_t size) {
                   for (std::size_t i = 0; i < size; ++i, ++fate)
                     if (others.has({block.x[i], block.y[i], block.z[i]})) *fate = Fate::agreeing;
                 });
  for (const auto& [seen, view_from_cloud] : views) {
    const View view(seen);
    const DirectionGrid grid =
        grid_of(compose(view_from_cloud, other_from_points), seen.rows, seen.columns);
    fate = fates.data();
    for_each_block(points, grid, [&](const DirectionBlock& block, std::size_t size) {
      for (std::size_t i = 0; i < size; ++i, ++fate) {
        if (*fate >= Fate::before || !view.contains(block.cell[i], block.range[i])) continue;
        const float nearest = view.nearest(block.cell[i]);
        const Fate here = nearest == 0                      ? Fate::open
                          : block.range[i] < nearest - near ? Fate::before
                                                            : Fate::behind;
        *fate = std::max(*fate, here);
      }
    });
  }
  OverlapCounts counts;
  for (const Fate each : fates) {
    counts.agreeing += each == Fate::agreeing;
    counts.before += each == Fate::before;
    counts.behind += each == Fate::behind;
    counts.open += each == Fate::open;
    counts.outside += each == Fate::outside;
  }
  return counts;
}

}  // namespace fusionslam
