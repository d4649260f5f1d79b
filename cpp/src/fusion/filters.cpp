// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>

#include "../detail/cell_table.hpp"
#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "fusionslam/fusion.hpp"

namespace fusionslam {
namespace {

constexpr double most_across = 1 << 21;

/// Sums of the points of one cube.
struct Cube {
  std::size_t first = 0;
  std::size_t count = 0;
  std::array<double, 3> position{};
  std::array<std::uint64_t, 3> color{};
};

void check_span(PointsView points, double size) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    float lowest = points[0][axis], highest = lowest;
    for (std::size_t i = 1; i < points.size; ++i) {
      lowest = std::min(lowest, points[i][axis]);
      highest = std::max(highest, points[i][axis]);
    }
    const double across = std::floor(highest / size) - std::floor(lowest / size);
    if (!(across < most_across))  // NaN where a tiny size overflows
      throw DataError("the cloud spans more than 2^21 voxels of " + std::to_string(size) + " m");
  }
}

std::vector<Cube> collect(PointsView points, ColorsView colors, double size) {
  check_span(points, size);
  detail::CellTable cells(size, points.size);
  std::vector<Cube> cubes;
  for (std::size_t i = 0; i < points.size; ++i) {
    if (i % 4096 == 0) detail::check_interrupt();
    const std::size_t number = cells.insert(points[i]);
    if (number == cubes.size()) cubes.push_back({i});
    Cube& cube = cubes[number];
    ++cube.count;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      cube.position[axis] += points[i][axis];
      if (colors.data) cube.color[axis] += colors.at(i, static_cast<int>(axis));
    }
  }
  return cubes;
}

}  // namespace

ColoredCloud voxel_downsample(PointsView points, ColorsView colors, double size) {
  if (!(size > 0)) throw ConfigError("voxel size is " + std::to_string(size) + ", expected > 0");
  detail::check_points(points, 0, "voxel_downsample");
  if (colors.data) detail::check_colors(points, colors);
  ColoredCloud result;
  if (points.size == 0) return result;
  for (const Cube& cube : collect(points, colors, size)) {
    const auto count = static_cast<double>(cube.count);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      result.points.push_back(static_cast<float>(cube.position[axis] / count));
      if (colors.data)
        result.colors.push_back(static_cast<std::uint8_t>(std::lround(cube.color[axis] / count)));
    }
    result.indices.push_back(static_cast<std::int64_t>(cube.first));
  }
  return result;
}

std::vector<std::int64_t> drop_invalid(PointsView points) {
  std::vector<std::int64_t> kept;
  kept.reserve(points.size);
  for (std::size_t i = 0; i < points.size; ++i)
    if (detail::is_finite(points[i])) kept.push_back(static_cast<std::int64_t>(i));
  return kept;
}

}  // namespace fusionslam
