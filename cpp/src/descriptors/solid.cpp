// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// SOLiD (Kim, Choi, Sim, Kim, Cho, IEEE Robotics and Automation Letters 2024).
#include "fusionslam/descriptors/solid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <sstream>

#include "../detail/cell_table.hpp"
#include "../detail/checks.hpp"
#include "polar_grid.hpp"

namespace fusionslam {
namespace {

constexpr std::size_t ranges = 40;
constexpr std::size_t azimuths = 60;

/// Counts of points over a bin of range or azimuth and one of elevation, rows of elevations.
struct Counts {
  std::size_t elevations;
  std::vector<double> by_range = std::vector<double>(ranges * elevations);
  std::vector<double> by_azimuth = std::vector<double>(azimuths * elevations);
  std::vector<double> by_elevation = std::vector<double>(elevations);
};

/// x, y, z of the mean point of each voxel, voxels in the order of their first points.
std::vector<std::array<float, 3>> voxel_means(PointsView points, double side) {
  struct Sum {
    double x = 0, y = 0, z = 0, points = 0;
  };
  detail::CellTable cells(side, points.size);
  std::vector<Sum> sums;
  for (std::size_t i = 0; i < points.size; ++i) {
    const std::uint32_t cell = cells.insert(points[i]);
    if (cell == sums.size()) sums.emplace_back();
    Sum& sum = sums[cell];
    sum.x += points[i][0];
    sum.y += points[i][1];
    sum.z += points[i][2];
    ++sum.points;
  }
  std::vector<std::array<float, 3>> means;
  means.reserve(sums.size());
  for (const Sum& sum : sums)
    means.push_back({static_cast<float>(sum.x / sum.points), static_cast<float>(sum.y / sum.points),
                     static_cast<float>(sum.z / sum.points)});
  return means;
}

/// The bin of elevation of a point, or -1 outside of them.
std::ptrdiff_t elevation_bin(const float* point, const SolidConfig& config) {
  const double x = point[0], y = point[1];
  const double degrees =
      std::atan2(static_cast<double>(point[2]), std::sqrt(x * x + y * y)) * 180 / std::numbers::pi;
  const double share =
      (degrees - config.lowest_elevation) / (config.highest_elevation - config.lowest_elevation);
  const double bin = std::floor(share * config.elevations);
  return bin >= 0 && bin < config.elevations ? static_cast<std::ptrdiff_t>(bin) : -1;
}

Counts count_points(PointsView points, const SolidConfig& config) {
  Counts counts{static_cast<std::size_t>(config.elevations)};
  const detail::PolarGrid grid{static_cast<int>(azimuths), static_cast<int>(ranges),
                               config.max_range};
  for (const auto& point : voxel_means(points, config.voxel)) {
    const std::ptrdiff_t polar = grid.bin_of(point.data());
    const std::ptrdiff_t elevation = elevation_bin(point.data(), config);
    if (polar < 0 || elevation < 0) continue;
    const auto bin = static_cast<std::size_t>(polar), e = static_cast<std::size_t>(elevation);
    ++counts.by_range[bin % ranges * counts.elevations + e];
    ++counts.by_azimuth[bin / ranges * counts.elevations + e];
    ++counts.by_elevation[e];
  }
  return counts;
}

/// Counts scaled from 0 for the least to 1 for the most.
std::vector<double> weigh(const std::vector<double>& counts) {
  const auto [least, most] = std::ranges::minmax(counts);
  std::vector<double> weights(counts.size(), 1);
  if (most > least)
    for (std::size_t i = 0; i < counts.size(); ++i)
      weights[i] = (counts[i] - least) / (most - least);
  return weights;
}

/// Product of a matrix of counts, one row a bin, with the weights of its columns.
std::vector<float> weighted_sums(const std::vector<double>& counts,
                                 const std::vector<double>& weights) {
  std::vector<float> sums;
  for (auto row = counts.begin(); row != counts.end();
       row += static_cast<std::ptrdiff_t>(weights.size())) {
    double sum = 0;
    for (std::size_t e = 0; e < weights.size(); ++e)
      sum += row[static_cast<std::ptrdiff_t>(e)] * weights[e];
    sums.push_back(static_cast<float>(sum));
  }
  return sums;
}

void check_azimuths(std::span<const float> values, const char* name) {
  if (values.size() != azimuths)
    throw ShapeError(std::string(name) + " has " + detail::count_text(values.size(), "value") +
                     ", expected the " + std::to_string(azimuths) + " azimuths of solid_parts");
  if (!std::ranges::all_of(values, [](float value) { return std::isfinite(value); }))
    throw DataError(std::string(name) + " has NaN or infinity");
}

}  // namespace

SolidParts solid_parts(PointsView points, const SolidConfig& config) {
  validate(config);
  if (!(config.lowest_elevation < config.highest_elevation))
    throw ConfigError("solid.lowest_elevation is " + std::to_string(config.lowest_elevation) +
                      ", expected less than solid.highest_elevation, which is " +
                      std::to_string(config.highest_elevation));
  detail::check_points(points, 1, "SOLiD");
  const Counts counts = count_points(points, config);
  if (std::ranges::all_of(counts.by_elevation, [](double count) { return count == 0; })) {
    std::ostringstream message;
    message << "SOLiD: the cloud has no point within solid.max_range, which is " << config.max_range
            << " m, between solid.lowest_elevation and solid.highest_elevation, "
            << config.lowest_elevation << " and " << config.highest_elevation << " degrees";
    throw DataError(message.str());
  }
  const std::vector<double> weights = weigh(counts.by_elevation);
  return {weighted_sums(counts.by_range, weights), weighted_sums(counts.by_azimuth, weights)};
}

std::vector<float> solid(PointsView points, const SolidConfig& config) {
  std::vector<float> sums = solid_parts(points, config).ranges;
  double squares = 0;
  for (const float sum : sums) squares += static_cast<double>(sum) * sum;
  for (float& sum : sums) sum = static_cast<float>(sum / std::sqrt(squares));
  return sums;
}

TurnedMatch compare_solid_azimuths(std::span<const float> query, std::span<const float> match) {
  check_azimuths(query, "query");
  check_azimuths(match, "match");
  double least = std::numeric_limits<double>::infinity();
  std::size_t best = 0;
  for (std::size_t turn = 0; turn < azimuths; ++turn) {
    double sum = 0;
    for (std::size_t i = 0; i < azimuths; ++i)
      sum += std::abs(static_cast<double>(query[i]) - match[(i + turn) % azimuths]);
    if (sum >= least) continue;
    least = sum;
    best = turn;
  }
  const double yaw = 2 * std::numbers::pi * static_cast<double>(best) / azimuths;
  constexpr double most = std::numeric_limits<float>::max();
  return {static_cast<float>(std::min(least, most)),
          yaw > std::numbers::pi ? yaw - 2 * std::numbers::pi : yaw};
}

}  // namespace fusionslam
