// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Ensemble of Shape Functions (Wohlkinger, Vincze, ROBIO 2011), with PCL's weights and thresholds.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <random>
#include <string>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "fusionslam/descriptors.hpp"

namespace fusionslam {
namespace {

constexpr int bins = 64;
constexpr int half_grid = 32;
constexpr int grid = 2 * half_grid;
constexpr int triangles = 20000;
constexpr int most_draws = 20 * triangles;

/// Lines with at most so many voxels on the surface are off it; of triangles, three times as many.
constexpr int most_hits_off = 7;

/// Triangles with fewer voxels off the surface than this are on it.
constexpr int least_misses = 4;

/// Squared area, in voxels, of triangles that are none.
constexpr double least_squared_area = 0.001;

enum Lie { on = 0, off = 1, mixed = 2 };

using Voxel = std::array<int, 3>;
using Point = std::array<float, 3>;
using Vector = std::array<double, 3>;

/// In double: the areas of thin triangles are small differences of sides.
double length(const Vector& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

Vector between(const Point& from, const Point& to) {
  Vector result;
  for (std::size_t axis = 0; axis < 3; ++axis)
    result[axis] = static_cast<double>(to[axis]) - static_cast<double>(from[axis]);
  return result;
}

/// The cloud about its mean, the farthest point at a distance of `half_grid`.
std::vector<Point> scaled(PointsView points) {
  std::array<double, 3> mean{};
  for (std::size_t i = 0; i < points.size; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis) mean[axis] += points[i][axis];
  for (double& value : mean) value /= static_cast<double>(points.size);
  double farthest = 0;
  for (std::size_t i = 0; i < points.size; ++i)
    farthest = std::max(farthest, std::hypot(points[i][0] - mean[0], points[i][1] - mean[1],
                                             points[i][2] - mean[2]));
  if (!(farthest > 0)) throw DataError("all points of the cloud are equal: it has no ESF");
  std::vector<Point> result(points.size);
  for (std::size_t i = 0; i < points.size; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis)
      result[i][axis] = static_cast<float>((points[i][axis] - mean[axis]) / farthest * half_grid);
  return result;
}

Voxel voxel_of(const Point& point) {
  Voxel voxel;
  for (std::size_t axis = 0; axis < 3; ++axis)
    voxel[axis] = std::clamp(static_cast<int>(std::floor(point[axis])) + half_grid, 0, grid - 1);
  return voxel;
}

/// Voxels with a point, or next to one.
class Surface {
 public:
  explicit Surface(const std::vector<Point>& points) : voxels_(grid * grid * grid) {
    std::vector<std::uint8_t> filled(voxels_.size());
    for (const Point& point : points) filled[index(voxel_of(point))] = 1;
    for (int x = 0; x < grid; ++x)
      for (int y = 0; y < grid; ++y)
        for (int z = 0; z < grid; ++z)
          if (filled[index({x, y, z})]) fill_around({x, y, z});
  }

  bool contains(const Voxel& voxel) const { return voxels_[index(voxel)] != 0; }

 private:
  static std::size_t index(const Voxel& voxel) {
    return static_cast<std::size_t>((voxel[0] * grid + voxel[1]) * grid + voxel[2]);
  }
  void fill_around(const Voxel& center) {
    const auto low = [](int i) { return std::max(i - 1, 0); };
    const auto high = [](int i) { return std::min(i + 1, grid - 1); };
    for (int x = low(center[0]); x <= high(center[0]); ++x)
      for (int y = low(center[1]); y <= high(center[1]); ++y)
        for (int z = low(center[2]); z <= high(center[2]); ++z) voxels_[index({x, y, z})] = 1;
  }

  std::vector<std::uint8_t> voxels_;
};

/// How many voxels of a line there are, and how many of these lie on the surface.
struct Line {
  int voxels = 0;
  int hits = 0;

  Lie lie() const { return hits >= voxels - 1 ? on : hits <= most_hits_off ? off : mixed; }
  double share() const { return hits / static_cast<double>(voxels); }
};

/// Walks from one voxel to the one before the other (Bresenham in three dimensions).
Line trace(const Surface& surface, const Voxel& from, const Voxel& to) {
  Voxel length, step;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    length[axis] = std::abs(to[axis] - from[axis]);
    step[axis] = to[axis] < from[axis] ? -1 : 1;
  }
  const std::size_t longest = length[0] >= std::max(length[1], length[2]) ? 0
                              : length[1] >= length[2]                    ? 1
                                                                          : 2;
  const std::array<std::size_t, 2> others{(longest + 1) % 3, (longest + 2) % 3};
  std::array<int, 2> error{2 * length[others[0]] - length[longest],
                           2 * length[others[1]] - length[longest]};
  Line line{std::max(length[longest], 1), 0};
  Voxel voxel = from;
  for (int i = 0; i < line.voxels; ++i) {
    line.hits += surface.contains(voxel) ? 1 : 0;
    for (std::size_t k = 0; k < 2; ++k) {
      if (error[k] > 0) {
        voxel[others[k]] += step[others[k]];
        error[k] -= 2 * length[longest];
      }
      error[k] += 2 * length[others[k]];
    }
    voxel[longest] += step[longest];
  }
  return line;
}

/// A triangle: side i is opposite corner i.
struct Triangle {
  Vector sides;
  std::array<std::size_t, 3> angle_bins;
  std::array<Line, 3> lines;
  double root_area;
  Lie lie;
};

/// Bin of the angle at corner i between its two sides, of at most 90 degrees.
std::size_t angle_bin(const std::array<Vector, 3>& sides, const Vector& lengths, std::size_t i) {
  const std::size_t j = (i + 1) % 3, k = (i + 2) % 3;
  const Vector &a = sides[j], &b = sides[k];
  const double cosine = (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) / (lengths[j] * lengths[k]);
  const double angle = std::acos(std::min(std::abs(cosine), 1.0));
  return static_cast<std::size_t>(std::lround(angle / (std::numbers::pi / 2) * (bins - 1)));
}

Lie lie_of(const std::array<Line, 3>& lines) {
  int hits = 0, voxels = 0;
  for (const Line& line : lines) {
    hits += line.hits;
    voxels += line.voxels;
  }
  return hits <= 3 * most_hits_off ? off : voxels - hits < least_misses ? on : mixed;
}

/// Numbers from 0 to size - 1, the same everywhere (std::uniform_int_distribution is not).
std::size_t draw(std::mt19937& random, std::size_t size) {
  return static_cast<std::size_t>(static_cast<std::uint64_t>(random()) * size >> 32);
}

/// The triangle of three points, if it has an area.
std::optional<Triangle> triangle(const std::array<Point, 3>& corners, const Surface& surface) {
  std::array<Vector, 3> sides;
  Triangle t;
  for (std::size_t i = 0; i < 3; ++i) {
    sides[i] = between(corners[(i + 1) % 3], corners[(i + 2) % 3]);
    t.sides[i] = length(sides[i]);
  }
  const double s = (t.sides[0] + t.sides[1] + t.sides[2]) / 2;
  const double squared_area = s * (s - t.sides[0]) * (s - t.sides[1]) * (s - t.sides[2]);
  if (!(squared_area > least_squared_area)) return std::nullopt;
  t.root_area = std::sqrt(std::sqrt(squared_area));
  for (std::size_t i = 0; i < 3; ++i) {
    t.angle_bins[i] = angle_bin(sides, t.sides, i);
    // From the corner of the lower number, as lines back may pass other voxels.
    const std::size_t from = i == 0 ? 1 : 0, to = i == 2 ? 1 : 2;
    t.lines[i] = trace(surface, voxel_of(corners[from]), voxel_of(corners[to]));
  }
  t.lie = lie_of(t.lines);
  return t;
}

std::vector<Triangle> draw_triangles(const std::vector<Point>& points, const Surface& surface) {
  std::mt19937 random;  // the default seed
  std::vector<Triangle> result;
  result.reserve(triangles);
  for (int draws = 0; result.size() < triangles; ++draws) {
    if (draws == most_draws)
      throw DataError("ESF: of " + std::to_string(most_draws) + " triples of points, only " +
                      std::to_string(result.size()) + " are triangles, " +
                      std::to_string(triangles) + " are needed (do all points lie on a line?)");
    if (draws % 4096 == 0) detail::check_interrupt();
    std::array<Point, 3> corners;
    for (Point& corner : corners) corner = points[draw(random, points.size())];
    if (const auto found = triangle(corners, surface)) result.push_back(*found);
  }
  return result;
}

std::size_t bin_of(double value, double largest) {
  return static_cast<std::size_t>(std::lround(value / largest * (bins - 1)));
}

using Histograms = std::array<std::array<double, bins>, 10>;

Histograms count(const std::vector<Triangle>& drawn) {
  // In each group on, off and mixed; the share has one.
  constexpr std::size_t angles = 0, areas = 3, lengths = 6, shares = 9;
  double longest = 0, largest = 0;
  for (const Triangle& t : drawn) {
    longest = std::max({longest, t.sides[0], t.sides[1], t.sides[2]});
    largest = std::max(largest, t.root_area);
  }
  Histograms histograms{};
  for (const Triangle& t : drawn) {
    ++histograms[areas + t.lie][bin_of(t.root_area, largest)];
    for (std::size_t i = 0; i < 3; ++i) {
      const Line& line = t.lines[i];
      histograms[angles + t.lie][t.angle_bins[i]] += line.voxels / static_cast<double>(half_grid);
      ++histograms[lengths + line.lie()][bin_of(t.sides[i], longest)];
      if (line.lie() == mixed)
        ++histograms[shares][static_cast<std::size_t>(std::lround(line.share() * (bins - 1)))];
    }
  }
  return histograms;
}

}  // namespace

std::vector<float> esf(PointsView points) {
  constexpr std::array<double, 10> weights{0.5, 0.5, 0.5, 0.5, 0.5, 1, 0.5, 2, 2, 1};
  detail::check_points(points, 3, "ESF");
  const std::vector<Point> cloud = scaled(points);
  const Histograms histograms = count(draw_triangles(cloud, Surface(cloud)));
  double sum = 0;
  for (std::size_t h = 0; h < histograms.size(); ++h)
    for (const double value : histograms[h]) sum += weights[h] * value;
  std::vector<float> descriptor;
  descriptor.reserve(histograms.size() * bins);
  for (std::size_t h = 0; h < histograms.size(); ++h)
    for (const double value : histograms[h])
      descriptor.push_back(static_cast<float>(weights[h] * value / sum));
  return descriptor;
}

}  // namespace fusionslam
