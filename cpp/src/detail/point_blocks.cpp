// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "point_blocks.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "fusionslam/errors.hpp"
#include "interrupt.hpp"
#include "parallel.hpp"

namespace fusionslam::detail {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();

/// A point on its way to its place.
struct Item {
  std::array<float, 3> position;
  std::uint32_t index;
};

struct Range {
  std::size_t begin, end;
};

constexpr Box empty_box() {
  return {{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}};
}

std::size_t widest_axis(const Item* items, std::size_t size) {
  std::array<float, 3> low = items[0].position, high = items[0].position;
  for (std::size_t i = 1; i < size; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], items[i].position[axis]);
      high[axis] = std::max(high[axis], items[i].position[axis]);
    }
  std::size_t widest = 0;
  for (std::size_t axis = 1; axis < 3; ++axis)
    if (high[axis] - low[axis] > high[widest] - low[widest]) widest = axis;
  return widest;
}

/// Moves the smaller half along the widest axis to the front and returns its size, a multiple of
/// the largest power of 16 that allows one: so the children of a group were split off last.
std::size_t split(Item* items, std::size_t size) {
  std::size_t span = block_size;
  while (span * block_size < size) span *= block_size;
  const std::size_t children = (size + span - 1) / span;
  const std::size_t left = (children + 1) / 2 * span;
  const auto compare = [axis = widest_axis(items, size)](const Item& a, const Item& b) {
    return a.position[axis] < b.position[axis];
  };
  std::nth_element(items, items + left, items + size, compare);
  return left;
}

/// Orders items[begin, end), except that ranges of at most `grain` are only added to `rest`.
void order(std::vector<Item>& items, Range range, std::size_t grain, std::vector<Range>& rest) {
  while (range.end - range.begin > grain) {
    check_interrupt();
    const std::size_t left = split(items.data() + range.begin, range.end - range.begin);
    order(items, {range.begin, range.begin + left}, grain, rest);
    range.begin += left;
  }
  if (grain > block_size) rest.push_back(range);
}

std::vector<Item> order_items(PointsView points, int threads) {
  std::vector<Item> items(points.size);
  for (std::size_t i = 0; i < points.size; ++i)
    items[i] = {{points[i][0], points[i][1], points[i][2]}, static_cast<std::uint32_t>(i)};
  constexpr std::size_t grain = 1 << 13;
  std::vector<Range> ranges;
  order(items, {0, items.size()}, grain, ranges);
  parallel_for(ranges.size(), threads, [&](std::size_t i) {
    std::vector<Range> none;
    order(items, ranges[i], block_size, none);
  });
  return items;
}

void check_magnitude(PointsView points) {
  constexpr float largest = 1e15F;  // far from where sums of squares overflow float
  for (std::size_t i = 0; i < points.size; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis)
      if (std::abs(points[i][axis]) > largest)
        throw DataError("point " + std::to_string(i) +
                        " has a coordinate beyond 1e15 m: distances between points overflow");
  if (points.size > std::numeric_limits<std::uint32_t>::max() - block_size)
    throw DataError("the cloud has more points than 32 bits count");
}

void set_box(BoxGroup& group, std::size_t i, const Box& box) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    group.low[axis][i] = box.low[axis];
    group.high[axis][i] = box.high[axis];
  }
}

Box box_of(const BoxGroup& group, std::size_t i) {
  return {{group.low[0][i], group.low[1][i], group.low[2][i]},
          {group.high[0][i], group.high[1][i], group.high[2][i]}};
}

void enclose(Box& box, const Box& other) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    box.low[axis] = std::min(box.low[axis], other.low[axis]);
    box.high[axis] = std::max(box.high[axis], other.high[axis]);
  }
}

Box box_of(const BoxGroup& group) {
  Box box = empty_box();
  for (std::size_t i = 0; i < block_size; ++i) enclose(box, box_of(group, i));
  return box;
}

std::vector<BoxGroup> group_boxes(const std::vector<Box>& boxes) {
  BoxGroup none;
  for (std::size_t i = 0; i < block_size; ++i) set_box(none, i, empty_box());
  std::vector<BoxGroup> groups((boxes.size() + block_size - 1) / block_size, none);
  for (std::size_t i = 0; i < boxes.size(); ++i)
    set_box(groups[i / block_size], i % block_size, boxes[i]);
  return groups;
}

}  // namespace

PointBlocks::PointBlocks(PointsView points, int threads, SimdLevel level)
    : kernels_(neighbor_kernels(level)) {
  check_magnitude(points);
  const std::vector<Item> items = order_items(points, threads);
  points_.reserve(items.size());
  indices_.reserve(items.size());
  for (const Item& item : items) {
    points_.push_back({item.position[0], item.position[1], item.position[2]});
    indices_.push_back(item.index);
  }
  set_blocks();
  set_boxes();
}

void PointBlocks::set_blocks() {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  blocks_.resize((size() + block_size - 1) / block_size);
  for (std::size_t i = 0; i < blocks_.size() * block_size; ++i) {
    const Point point = i < size() ? points_[i] : Point{nan, nan, nan};
    PointBlock& block = blocks_[i / block_size];
    block.x[i % block_size] = point.x;
    block.y[i % block_size] = point.y;
    block.z[i % block_size] = point.z;
  }
}

void PointBlocks::set_boxes() {
  std::vector<Box> boxes(block_count(), empty_box());
  for (std::size_t i = 0; i < size(); ++i) {
    const Point& p = points_[i];
    enclose(boxes[i / block_size], {{p.x, p.y, p.z}, {p.x, p.y, p.z}});
  }
  levels_.push_back(group_boxes(boxes));
  while (levels_.back().size() > 1) {
    boxes.clear();
    for (const BoxGroup& group : levels_.back()) boxes.push_back(box_of(group));
    levels_.push_back(group_boxes(boxes));
  }
}

Box PointBlocks::block_box(std::size_t block) const {
  return box_of(levels_[0][block / block_size], block % block_size);
}

void PointBlocks::blocks_within(const Box& box, float squared_radius,
                                std::vector<std::uint32_t>& found) const {
  found.assign(levels_.back().size(), 0);  // the root
  std::vector<std::uint32_t> groups;
  for (auto level = levels_.rbegin(); level != levels_.rend(); ++level) {
    groups.swap(found);
    found.resize(groups.size() * block_size);
    std::size_t size = 0;
    for (const std::uint32_t group : groups)
      size += kernels_.boxes_within((*level)[group], box, squared_radius,
                                    group * static_cast<std::uint32_t>(block_size),
                                    found.data() + size);
    found.resize(size);
  }
}

}  // namespace fusionslam::detail
