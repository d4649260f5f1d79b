// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// GASD with colour (Lima, Teichrieb, SIBGRAPI 2016), the values of PCL's GASDColorEstimation.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "../detail/checks.hpp"
#include "cloud_axes.hpp"
#include "fusionslam/descriptors.hpp"

namespace fusionslam {
namespace {

constexpr std::size_t shape_cells = 6;
constexpr std::size_t color_cells = 4;
constexpr std::size_t hue_bins = 12;
constexpr std::size_t shape_size = shape_cells * shape_cells * shape_cells;
constexpr std::size_t gasd_size = shape_size + color_cells * color_cells * color_cells * hue_bins;

/// Coordinates in the frame of the cloud.
using Aligned = std::vector<std::array<double, 3>>;

/// x along the longest axis, z along the shortest one and away from the cloud's z.
Aligned align(PointsView points) {
  const detail::OwnFrame own = detail::principal_axes(points, AxisSigns::largest_entry);
  Eigen::Vector3d x = own.axes.row(0), z = own.axes.row(2);
  if (z.z() > 0) z = -z;
  const auto offset = [&](std::size_t i) -> Eigen::Vector3d {
    return Eigen::Vector3d(points[i][0], points[i][1], points[i][2]) - own.mean;
  };
  double third_moment = 0;
  for (std::size_t i = 0; i < points.size; ++i) {
    const double along = x.dot(offset(i));
    third_moment += along * along * along;
  }
  if (third_moment < 0) x = -x;
  const Eigen::Vector3d y = z.cross(x);
  Aligned aligned(points.size);
  for (std::size_t i = 0; i < points.size; ++i) {
    const Eigen::Vector3d p = offset(i);
    aligned[i] = {x.dot(p), y.dot(p), z.dot(p)};
  }
  return aligned;
}

/// Hue in bins, 0 for greys.
std::size_t hue_bin(ColorsView colors, std::size_t i) {
  const int r = colors.at(i, 0), g = colors.at(i, 1), b = colors.at(i, 2);
  const int largest = std::max({r, g, b}), range = largest - std::min({r, g, b});
  if (range == 0) return 0;
  // In sixths of a turn, over the common denominator.
  const int sixths = largest == r   ? (g < b ? g - b + 6 * range : g - b)
                     : largest == g ? b - r + 2 * range
                                    : r - g + 4 * range;
  return static_cast<std::size_t>(2 * sixths / range) % hue_bins;
}

/// Number of the cell of a point in a cube of `cells` a side; `outside` on the cube's far faces.
constexpr std::size_t outside = static_cast<std::size_t>(-1);
std::size_t cell_of(const std::array<double, 3>& point, double half_side, std::size_t cells) {
  std::size_t number = 0;
  const double half = static_cast<double>(cells) / 2;
  for (const double value : point) {
    const auto place = static_cast<std::size_t>(std::floor(value / half_side * half + half));
    if (place >= cells) return outside;
    number = number * cells + place;
  }
  return number;
}

}  // namespace

std::vector<float> gasd_color(PointsView points, ColorsView colors) {
  detail::check_points(points, 4, "GASD");
  detail::check_colors(points, colors);
  const Aligned aligned = align(points);
  double half_side = 0;
  for (const auto& point : aligned)
    for (const double value : point) half_side = std::max(half_side, std::abs(value));
  std::vector<std::uint32_t> counts(gasd_size);
  for (std::size_t i = 0; i < points.size; ++i) {
    const std::size_t shape = cell_of(aligned[i], half_side, shape_cells);
    const std::size_t color = cell_of(aligned[i], half_side, color_cells);
    if (shape != outside) ++counts[shape];
    if (color != outside) ++counts[shape_size + color * hue_bins + hue_bin(colors, i)];
  }
  std::vector<float> descriptor;
  descriptor.reserve(gasd_size);
  for (const std::uint32_t count : counts)
    descriptor.push_back(static_cast<float>(100.0 * count / static_cast<double>(points.size - 1)));
  return descriptor;
}

}  // namespace fusionslam
