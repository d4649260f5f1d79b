// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "fusionslam/fusion.hpp"

namespace fusionslam {
namespace {

constexpr int axis_bits = 21;  // three cube numbers share one 64-bit key

/// Sums of the points of one cube.
struct Cube {
  std::size_t first = 0;
  std::size_t count = 0;
  std::array<double, 3> position{};
  std::array<std::uint64_t, 3> color{};
};

std::array<double, 3> lowest_corner(PointsView points) {
  std::array<double, 3> lowest{points[0][0], points[0][1], points[0][2]};
  for (std::size_t i = 1; i < points.size; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis)
      lowest[axis] = std::min(lowest[axis], static_cast<double>(points[i][axis]));
  return lowest;
}

std::uint64_t cube_key(const float* point, const std::array<double, 3>& origin, double size) {
  std::uint64_t key = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double number = std::floor(point[axis] / size) - std::floor(origin[axis] / size);
    if (!(number < (1 << axis_bits)))  // NaN where a tiny size overflows
      throw DataError("the cloud spans more than 2^21 voxels of " + std::to_string(size) + " m");
    key = key << axis_bits | static_cast<std::uint64_t>(number);
  }
  return key;
}

std::vector<Cube> collect(PointsView points, ColorsView colors, double size) {
  const auto origin = lowest_corner(points);
  std::unordered_map<std::uint64_t, std::size_t> cube_of_key;
  std::vector<Cube> cubes;
  for (std::size_t i = 0; i < points.size; ++i) {
    if (i % 4096 == 0) detail::check_interrupt();
    const auto [place, is_new] =
        cube_of_key.try_emplace(cube_key(points[i], origin, size), cubes.size());
    if (is_new) cubes.push_back({i});
    Cube& cube = cubes[place->second];
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
