// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The counting loop, which finds rings and sectors without sqrt and atan2, against one with them.
#include <doctest/doctest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "descriptors/m2dp_kernel.hpp"

namespace fusionslam::detail {
namespace {

using std::numbers::pi;

constexpr int color_bins = 5;
constexpr double outer_radius = 9;

/// The edges as the header of the kernel describes them.
struct Edges {
  std::vector<double> rings, cosines, sines;
  KernelBins bins{};

  Edges(int ring_count, int sectors) {
    for (int i = 1; i < ring_count; ++i)
      rings.push_back(std::pow(std::sqrt(outer_radius) * i / ring_count, 4));
    for (int i = 0; i < sectors; ++i) {
      cosines.push_back(std::cos(-pi + 2 * pi * i / sectors));
      sines.push_back(std::sin(-pi + 2 * pi * i / sectors));
    }
    bins = {rings.data(), cosines.data(),    sines.data(), ring_count,
            sectors,      (sectors + 1) / 2, sectors / 2,  color_bins};
  }
};

struct Points {
  std::vector<double> x, y, z;
  std::vector<std::uint8_t> colors;

  void add(double px, double py, double pz) {
    x.push_back(px);
    y.push_back(py);
    z.push_back(pz);
    for (std::size_t c = 0; c < 3; ++c)
      colors.push_back(static_cast<std::uint8_t>((x.size() + c * c) % color_bins));
  }
  KernelCloud kernel(std::size_t first, std::size_t count) const {
    return {x.data() + first, y.data() + first, z.data() + first, colors.data() + 3 * first, count};
  }
};

Points random_points() {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-6, 6);
  Points points;
  for (int i = 0; i < 3000; ++i) points.add(uniform(random), uniform(random), uniform(random));
  return points;
}

/// Many lie on edges: in the middle, on the axes and on the diagonals.
Points grid_points() {
  Points points;
  for (int x = -8; x <= 8; ++x)
    for (int y = -8; y <= 8; ++y) points.add(0.5 * x, 0.5 * y, 0.25 * (x + y));
  return points;
}

struct Place {
  double ring, sector;  ///< as real numbers; the bin is the floor
};

Place naive_place(const Points& points, std::size_t i, const KernelPlane& plane,
                  const KernelBins& bins) {
  const auto along = [&](const double* a) {
    return points.x[i] * a[0] + points.y[i] * a[1] + points.z[i] * a[2];
  };
  const double x = along(plane.x_axis), y = along(plane.y_axis);
  return {std::sqrt(std::sqrt(x * x + y * y)) / std::sqrt(outer_radius) * bins.rings,
          (std::atan2(y, x) + pi) / (2 * pi) * bins.sectors};
}

/// `bin` is the floor of `place`, or the other side of an edge within rounding; past the last bin
/// follows the first if `wraps`, else the last again.
bool fits(int bin, double place, int count, bool wraps) {
  for (const double shift : {-1e-12, 0.0, 1e-12}) {
    int expected = static_cast<int>(std::floor(place + shift));
    if (expected < 0) expected = wraps ? count - 1 : 0;
    if (expected >= count) expected = wraps && shift >= 0 && place <= count ? 0 : count - 1;
    if (bin == expected || (expected == 0 && wraps && place >= count - 1e-12 && bin == count - 1))
      return true;
  }
  return false;
}

std::vector<std::uint32_t> votes_of(const KernelCloud& cloud, const KernelPlane& plane,
                                    const KernelBins& bins) {
  std::vector<std::uint32_t> row(
      static_cast<std::size_t>(bins.rings * bins.sectors + 3 * bins.rings * bins.color_bins));
  count_votes(cloud, plane, bins, row.data());
  return row;
}

/// Position of the only vote in [begin, end), relative to begin; -1 if there is not exactly one.
int only_vote(const std::vector<std::uint32_t>& row, int begin, int end) {
  int found = -1;
  for (int i = begin; i < end; ++i) {
    const auto votes = row[static_cast<std::size_t>(i)];
    if (votes == 0) continue;
    if (votes > 1 || found >= 0) return -1;
    found = i - begin;
  }
  return found;
}

/// One point alone: its shape vote is where sqrt and atan2 put it, its colours in the same ring.
bool vote_is_right(const Points& points, std::size_t i, const KernelPlane& plane,
                   const KernelBins& bins) {
  const auto row = votes_of(points.kernel(i, 1), plane, bins);
  const int shape = bins.rings * bins.sectors;
  const int bin = only_vote(row, 0, shape);
  if (bin < 0) return false;
  const int ring = bin / bins.sectors, sector = bin % bins.sectors;
  const Place place = naive_place(points, i, plane, bins);
  if (!fits(ring, place.ring, bins.rings, false)) return false;
  if (!fits(sector, place.sector, bins.sectors, true)) return false;
  for (int channel = 0; channel < 3; ++channel) {
    const int begin = shape + channel * bins.rings * color_bins;
    const int color = points.colors[3 * i + static_cast<std::size_t>(channel)];
    if (only_vote(row, begin, begin + bins.rings * color_bins) != ring * color_bins + color)
      return false;
  }
  return true;
}

void check_kernel(const Points& points, const KernelPlane& plane, const KernelBins& bins) {
  std::vector<std::uint32_t> sum;
  int wrong = 0;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    wrong += !vote_is_right(points, i, plane, bins);
    const auto row = votes_of(points.kernel(i, 1), plane, bins);
    sum.resize(row.size());
    for (std::size_t column = 0; column < row.size(); ++column) sum[column] += row[column];
  }
  CHECK(wrong == 0);
  CHECK(votes_of(points.kernel(0, points.x.size()), plane, bins) == sum);
}

TEST_CASE("the kernel counts as sqrt and atan2 do, for any number of rings and sectors") {
  const KernelPlane flat{{1, 0, 0}, {0, 1, 0}};
  const KernelPlane skew{{0.9, -0.3, 0.1}, {0.2, 0.5, -0.8}};
  for (const auto& [rings, sectors] :
       {std::pair{8, 16}, {1, 1}, {1, 2}, {3, 3}, {5, 7}, {2, 15}, {64, 64}, {7, 31}}) {
    INFO(rings, " rings, ", sectors, " sectors");
    const Edges edges(rings, sectors);
    for (const KernelPlane& plane : {flat, skew}) {
      check_kernel(random_points(), plane, edges.bins);
      check_kernel(grid_points(), plane, edges.bins);
    }
  }
}

TEST_CASE("without colours the kernel leaves their columns alone") {
  const Points points = random_points();
  const Edges edges(8, 16);
  KernelCloud cloud = points.kernel(0, points.x.size());
  const KernelPlane plane{{1, 0, 0}, {0, 1, 0}};
  auto expected = votes_of(cloud, plane, edges.bins);
  cloud.color_bins = nullptr;
  std::fill(expected.begin() + 8 * 16, expected.end(), 0U);
  CHECK(votes_of(cloud, plane, edges.bins) == expected);
}

}  // namespace
}  // namespace fusionslam::detail
