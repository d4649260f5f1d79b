// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

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

/// Points by columns of one width and a bounded height, to find whether one lies near a place.
class NearTable {
 public:
  NearTable(PointsView points, float distance)
      : distance_(distance), lasts_(std::bit_ceil(2 * points.size + 1), none) {
    entries_.reserve(points.size);
    for (std::size_t i = 0; i < points.size; ++i) {
      const float* p = points[i];
      const Column column{cell_of(p[0]), cell_of(p[1]), cell_of(p[2]) / height};
      std::uint32_t& last = lasts_[slot_of(column)];
      entries_.push_back({column, {p[0], p[1], p[2]}, last});
      last = static_cast<std::uint32_t>(i);
    }
  }

  bool has(const std::array<float, 3>& place) const {
    const std::int32_t x = cell_of(place[0]), y = cell_of(place[1]), z = cell_of(place[2]);
    if (column_has({x, y, z / height}, place)) return true;  // most often
    for (std::int32_t k = (z - 1) / height; k <= (z + 1) / height; ++k)
      for (std::int32_t i = x - 1; i <= x + 1; ++i)
        for (std::int32_t j = y - 1; j <= y + 1; ++j)
          if (column_has({i, j, k}, place)) return true;
    return false;
  }

 private:
  struct Column {
    std::int32_t x, y, z;
    bool operator==(const Column&) const = default;
  };
  struct Entry {
    Column column;
    std::array<float, 3> point;
    std::uint32_t previous;  // of the same column
  };
  static constexpr std::uint32_t none = 0xffffffff;
  static constexpr std::int32_t height = 16;  // of a column, in widths

  std::int32_t cell_of(float coordinate) const {
    const double cell =
        std::floor(static_cast<double>(coordinate) / static_cast<double>(distance_));
    constexpr double last = 1 << 30;  // beyond, points share columns
    return static_cast<std::int32_t>(cell > -last ? std::min(cell, last) : -last);  // NaN: -last
  }
  /// Slot of a column, or the one that it would get.
  std::size_t slot_of(Column column) const {
    const std::size_t mask = lasts_.size() - 1;
    const auto key =
        (static_cast<std::uint64_t>(column.x) << 32 ^ static_cast<std::uint32_t>(column.y)) +
        static_cast<std::uint64_t>(column.z) * 0xd6e8feb86659fd93ULL;
    std::size_t slot = key * 0x9e3779b97f4a7c15ULL >> 32 & mask;
    while (lasts_[slot] != none && entries_[lasts_[slot]].column != column)
      slot = (slot + 1) & mask;
    return slot;
  }
  bool column_has(Column column, const std::array<float, 3>& p) const {
    for (auto i = lasts_[slot_of(column)]; i != none; i = entries_[i].previous) {
      const auto& q = entries_[i].point;
      const float x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
      if (x * x + y * y + z * z <= distance_ * distance_) return true;
    }
    return false;
  }

  float distance_;
  std::vector<std::uint32_t> lasts_;  // entries of columns
  std::vector<Entry> entries_;
};

/// What a sensor saw: its nearest ranges about a direction, and the limits of its view.
class View {
 public:
  explicit View(const NearestRanges& seen) : seen_(seen) {
    std::vector<float> farthest(static_cast<std::size_t>(seen.columns));  // of each column
    first_row_ = seen.rows;
    for (int row = 0; row < seen.rows; ++row) {
      const float* ranges = &seen.ranges[static_cast<std::size_t>(row * seen.columns)];
      if (std::all_of(ranges, ranges + seen.columns, [](float range) { return range == 0; }))
        continue;
      first_row_ = std::min(first_row_, row);
      last_row_ = row;
      for (std::size_t i = 0; i < farthest.size(); ++i)
        farthest[i] = farthest[i] < ranges[i] ? ranges[i] : farthest[i];
    }
    reach_ = *std::ranges::max_element(farthest);
    find_columns(farthest);
  }

  bool contains(int row, int column, float range) const {
    return row >= first_row_ && row <= last_row_ && range <= reach_ &&
           in_view_[static_cast<std::size_t>(column)];
  }

  /// The nearest range in the direction of the cell and the eight about it; 0 if there is none.
  float nearest(int row, int column) const {
    const int left = column == 0 ? seen_.columns - 1 : column - 1;
    const int right = column + 1 == seen_.columns ? 0 : column + 1;
    float nearest = 0;
    for (int r = std::max(0, row - 1); r <= std::min(seen_.rows - 1, row + 1); ++r)
      for (const int c : {left, column, right}) {
        const float range = at(r, c);
        if (range > 0 && (nearest == 0 || range < nearest)) nearest = range;
      }
    return nearest;
  }

 private:
  float at(int row, int column) const {
    return seen_.ranges[static_cast<std::size_t>(row * seen_.columns + column)];
  }

  /// All columns but wide gaps between used ones.
  void find_columns(const std::vector<float>& farthest) {
    const std::size_t columns = farthest.size();
    const auto used = [&](std::size_t column) { return farthest[column] > 0; };
    in_view_.assign(columns, true);
    const std::size_t hole = columns * hole_deg / 360;
    for (std::size_t i = 0; i < columns; ++i) {
      if (used(i) || !used((i + columns - 1) % columns)) continue;
      std::size_t gap = 1;
      while (!used((i + gap) % columns)) ++gap;
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
        if (*fate >= Fate::before) continue;
        const int row = block.cell[i] / grid.columns, column = block.cell[i] % grid.columns;
        if (!view.contains(row, column, block.range[i])) continue;
        const float nearest = view.nearest(row, column);
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
