// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Surface-shape histograms (Magnusson, Andreasson, Nüchter, Lilienthal, ICRA and JFR 2009).
#include "fusionslam/descriptors/ndt_histogram.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "../detail/cell_table.hpp"
#include "../detail/checks.hpp"

namespace fusionslam {
namespace {

constexpr std::size_t least_points = 5;
constexpr std::array<double, 4> shell_limits{3, 6, 9, 15};  ///< metres
constexpr std::size_t shells = shell_limits.size() + 1;
constexpr std::size_t plane_classes = 9;
constexpr std::size_t classes = plane_classes + 2;
constexpr std::size_t most_alignments = 4;

/// Directions of walls, half a turn.
constexpr int wall_bins = 180;
constexpr int smoothing = 7;          ///< bins to each side
constexpr int peak_width = 10;        ///< bins to each side
constexpr int least_separation = 30;  ///< bins between two peaks

/// |z| of a wall's unit normal is less than this: it rises by more than 60 degrees.
constexpr double steep = 0.5;

enum class Shape { line, plane, round };

struct Surface {
  Shape shape;
  std::size_t shell;
  Eigen::Vector3d normal;  ///< of a plane
};

/// Sums about a cell's first point, which keeps them small.
struct Moments {
  Eigen::Vector3d origin;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  std::size_t points = 0;
};

Eigen::Vector3d vector_of(const float* point) { return {point[0], point[1], point[2]}; }

std::vector<Moments> moments_of_cells(PointsView points, double cell) {
  detail::CellTable cells(cell, points.size);
  std::vector<Moments> moments;
  for (std::size_t i = 0; i < points.size; ++i) {
    const Eigen::Vector3d point = vector_of(points[i]);
    const std::uint32_t number = cells.insert(points[i]);
    if (number == moments.size()) moments.push_back({point});
    Moments& sums = moments[number];
    const Eigen::Vector3d offset = point - sums.origin;
    sums.sum += offset;
    sums.squares += offset * offset.transpose();
    ++sums.points;
  }
  return moments;
}

Surface surface_of(const Moments& moments, double evenness) {
  const auto count = static_cast<double>(moments.points);
  const Eigen::Vector3d mean = moments.sum / count;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(moments.squares / count -
                                                              mean * mean.transpose());
  const Eigen::Vector3d values = solver.eigenvalues();
  const double distance = (moments.origin + mean).norm();
  Surface surface{Shape::round, 0, solver.eigenvectors().col(0)};
  if (values[1] <= evenness * values[2])
    surface.shape = Shape::line;
  else if (values[0] <= evenness * values[1])
    surface.shape = Shape::plane;
  surface.shell = static_cast<std::size_t>(
      std::ranges::count_if(shell_limits, [&](double limit) { return distance >= limit; }));
  return surface;
}

bool is_wall(const Surface& surface) {
  return surface.shape == Shape::plane && std::abs(surface.normal.z()) < steep;
}

/// Angle of a wall's normal, which may point either way, in bins from 0 to 180.
double wall_direction(const Surface& surface) {
  const double turn = std::atan2(surface.normal.y(), surface.normal.x()) / std::numbers::pi;
  return (turn - std::floor(turn)) * wall_bins;
}

/// Bins between two directions of lines.
int separation(int a, int b) {
  const int apart = std::abs(a - b) % wall_bins;
  return std::min(apart, wall_bins - apart);
}

/// Number of walls by direction, each bin with its neighbours.
std::array<int, wall_bins> count_walls(const std::vector<Surface>& surfaces) {
  std::array<int, wall_bins> counts{}, smooth{};
  for (const Surface& surface : surfaces)
    if (is_wall(surface)) ++counts[static_cast<std::size_t>(wall_direction(surface)) % wall_bins];
  for (int bin = 0; bin < wall_bins; ++bin)
    for (int offset = -smoothing; offset <= smoothing; ++offset)
      smooth[static_cast<std::size_t>(bin)] +=
          counts[static_cast<std::size_t>((bin + offset + wall_bins) % wall_bins)];
  return smooth;
}

/// Mean direction of the walls about a bin, radians.
double mean_direction(const std::vector<Surface>& surfaces, int bin) {
  std::complex<double> sum = 0;
  for (const Surface& surface : surfaces)
    if (is_wall(surface) &&
        separation(static_cast<int>(wall_direction(surface)), bin) <= peak_width)
      sum += std::polar(1.0, 2 * std::numbers::pi * wall_direction(surface) / wall_bins);
  return std::arg(sum) / 2;
}

/// Azimuths that alignments turn to x.
std::vector<double> common_directions(const std::vector<Surface>& surfaces, double ambiguity) {
  std::array<int, wall_bins> counts = count_walls(surfaces);
  std::vector<double> directions;
  int commonest = 0;
  for (std::size_t i = 0; i < most_alignments / 2; ++i) {
    const auto peak = std::ranges::max_element(counts);
    const int bin = static_cast<int>(peak - counts.begin());
    if (*peak == 0 || *peak < ambiguity * commonest) break;
    commonest = std::max(commonest, *peak);
    const double direction = mean_direction(surfaces, bin);
    directions.insert(directions.end(), {direction, direction + std::numbers::pi});
    for (int other = 0; other < wall_bins; ++other)
      if (separation(bin, other) < least_separation) counts[static_cast<std::size_t>(other)] = 0;
  }
  if (directions.empty()) directions.push_back(0);
  return directions;
}

/// The directions that classes of planes have, upwards where they are not level.
std::array<Eigen::Vector3d, plane_classes> class_directions() {
  const double half = std::sqrt(0.5);
  return {{{0, 0, 1},
           {1, 0, 0},
           {half, half, 0},
           {0, 1, 0},
           {-half, half, 0},
           {half, 0, half},
           {0, half, half},
           {-half, 0, half},
           {0, -half, half}}};
}

std::size_t class_of(const Surface& surface,
                     const std::array<Eigen::Vector3d, plane_classes>& axes) {
  if (surface.shape == Shape::line) return 0;
  if (surface.shape == Shape::round) return classes - 1;
  std::array<double, plane_classes> cosines;
  std::ranges::transform(axes, cosines.begin(), [&](const Eigen::Vector3d& axis) {
    return std::abs(axis.dot(surface.normal));
  });
  return 1 + static_cast<std::size_t>(std::ranges::max_element(cosines) - cosines.begin());
}

/// Histogram of the surfaces turned so that `azimuth` comes to lie along x.
void write_histogram(const std::vector<Surface>& surfaces, double azimuth, float* histogram) {
  auto axes = class_directions();
  const double x = std::cos(azimuth), y = std::sin(azimuth);
  for (Eigen::Vector3d& axis : axes)  // turned instead of the surfaces
    axis = Eigen::Vector3d(x * axis.x() - y * axis.y(), y * axis.x() + x * axis.y(), axis.z());
  std::array<double, shells * classes> counts{};
  for (const Surface& surface : surfaces)
    ++counts[surface.shell * classes + class_of(surface, axes)];
  std::ranges::transform(counts, histogram, [&](double count) {
    return static_cast<float>(count / static_cast<double>(surfaces.size()));
  });
}

}  // namespace

std::vector<float> ndt_histogram(PointsView points, const NdtHistogramConfig& config) {
  validate(config);
  detail::check_points(points, 1, "ndt_histogram");
  std::vector<Surface> surfaces;
  for (const Moments& moments : moments_of_cells(points, config.cell))
    if (moments.points >= least_points) surfaces.push_back(surface_of(moments, config.evenness));
  if (surfaces.empty())
    throw DataError("ndt_histogram: no cell of ndt_histogram.cell, which is " +
                    std::to_string(config.cell) + " m, has " + std::to_string(least_points) +
                    " points");
  std::vector<float> histograms(most_alignments * shells * classes);
  float* next = histograms.data();
  for (const double azimuth : common_directions(surfaces, config.ambiguity)) {
    write_histogram(surfaces, azimuth, next);
    next += shells * classes;
  }
  return histograms;
}

}  // namespace fusionslam
