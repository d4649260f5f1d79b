// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// M2DP (He, Wang, Zhang, IROS 2016) and c-M2DP (Perdomo 2019, chapter 3).
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "../detail/checks.hpp"
#include "../detail/parallel.hpp"
#include "color_space.hpp"
#include "fusionslam/descriptors.hpp"
#include "m2dp_kernel.hpp"
#include "mirror_pairs.hpp"
#include "principal_axes.hpp"
#include "projection_planes.hpp"
#include "singular_vectors.hpp"

namespace fusionslam {
namespace {

using std::numbers::pi;

/// The cloud in its own frame, one array a coordinate.
struct AlignedCloud {
  std::array<std::vector<double>, 3> coordinates;
  double outer_radius = 0;

  std::size_t size() const { return coordinates[0].size(); }
};

AlignedCloud align(PointsView points, const M2dpConfig& config) {
  const auto frame = detail::principal_axes(points, config.axis_signs);
  AlignedCloud cloud;
  for (auto& coordinate : cloud.coordinates) coordinate.resize(points.size);
  double largest = 0;
  double sum = 0;
  for (std::size_t i = 0; i < points.size; ++i) {
    const Eigen::Vector3d p =
        frame.axes * (Eigen::Map<const Eigen::Vector3f>(points[i]).cast<double>() - frame.mean);
    for (std::size_t axis = 0; axis < 3; ++axis)
      cloud.coordinates[axis][i] = p[static_cast<Eigen::Index>(axis)];
    largest = std::max(largest, p.squaredNorm());
    sum += p.squaredNorm();
  }
  cloud.outer_radius = config.outer_radius == OuterRadius::farthest_point
                           ? std::sqrt(largest)
                           : 3 * std::sqrt(sum / static_cast<double>(points.size));
  return cloud;
}

/// Edges of rings and sectors; owns what KernelBins points to.
struct Bins {
  std::vector<double> ring_edges, sector_cosines, sector_sines;
  detail::KernelBins kernel{};

  Bins(const M2dpConfig& config, double outer_radius) {
    const double last_edge = std::sqrt(outer_radius);
    for (int i = 1; i < config.rings; ++i)
      ring_edges.push_back(std::pow(last_edge * i / config.rings, 4));
    int first_upper = config.sectors;
    for (int i = config.sectors - 1; i >= 0; --i)
      if (2 * i >= config.sectors) first_upper = i;
    for (int i = 0; i < config.sectors; ++i) {
      const double angle = -pi + 2 * pi * i / config.sectors;
      sector_cosines.push_back(std::cos(angle));
      sector_sines.push_back(std::sin(angle));
    }
    kernel = {ring_edges.data(), sector_cosines.data(), sector_sines.data(), config.rings,
              config.sectors,    first_upper,           config.sectors / 2,  config.color_bins};
  }
};

void check(const M2dpConfig& config) {
  validate(config);
  if (config.axis_signs == AxisSigns::mirror_pairs && config.azimuths % 4 != 0)
    throw ConfigError("m2dp.azimuths is " + std::to_string(config.azimuths) +
                      ", expected a multiple of 4 with axis_signs = mirror_pairs");
  if (config.axis_signs == AxisSigns::mirror_pairs && config.sectors % 2 != 0)
    throw ConfigError("m2dp.sectors is " + std::to_string(config.sectors) +
                      ", expected an even number with axis_signs = mirror_pairs");
}

/// Fills the signature; `color_bins` is null for M2DP.
Signature count(PointsView points, const std::uint8_t* color_bins, const M2dpConfig& config,
                int threads) {
  const AlignedCloud cloud = align(points, config);
  const Bins bins(config, cloud.outer_radius);
  const bool mirrored = config.axis_signs == AxisSigns::mirror_pairs;
  const auto planes = mirrored ? detail::mirrored_planes(config.azimuths, config.elevations)
                               : detail::grid_planes(config.azimuths, config.elevations);
  const detail::KernelCloud kernel_cloud{cloud.coordinates[0].data(), cloud.coordinates[1].data(),
                                         cloud.coordinates[2].data(), color_bins,
                                         cloud.size() - (config.drop_last_point ? 1 : 0)};

  const int columns = config.shape_columns() + (color_bins ? config.color_columns() : 0);
  Signature signature{config.planes(), columns, {}};
  signature.values.resize(planes.size() * static_cast<std::size_t>(columns));
  detail::parallel_for(planes.size(), threads, [&](std::size_t row) {
    std::vector<std::uint32_t> votes(static_cast<std::size_t>(columns));
    detail::count_votes(kernel_cloud, planes[row], bins.kernel, votes.data());
    std::transform(votes.begin(), votes.end(),
                   signature.values.begin() + static_cast<std::ptrdiff_t>(row * votes.size()),
                   [&](std::uint32_t vote) { return vote / static_cast<double>(cloud.size()); });
  });
  if (mirrored) detail::sort_mirror_pairs(config, planes, signature);
  return signature;
}

std::vector<float> describe(Signature signature, const M2dpConfig& config) {
  if (config.weighting == Weighting::square_root)
    for (double& value : signature.values) value = std::sqrt(value);
  return detail::first_singular_vectors(signature);
}

}  // namespace

M2dpConfig m2dp_preset(std::string_view name) {
  if (name == "robust") return {};
  if (name != "paper" && name != "author")
    throw ConfigError("preset is '" + std::string(name) +
                      "', expected one of paper, author, robust");
  M2dpConfig config;
  config.azimuths = 4;
  config.elevations = 16;
  config.outer_radius = OuterRadius::farthest_point;
  config.weighting = Weighting::counts;
  config.grey_world = false;
  const bool author = name == "author";
  config.axis_signs = author ? AxisSigns::pcl : AxisSigns::largest_entry;
  config.drop_last_point = author;
  config.author_lab = author;
  return config;
}

Signature m2dp_signature(PointsView points, const M2dpConfig& config, int threads) {
  check(config);
  detail::check_points(points, 4, "M2DP");
  return count(points, nullptr, config, threads);
}

Signature cm2dp_signature(PointsView points, ColorsView colors, ColorSpace color_space,
                          const M2dpConfig& config, int threads) {
  check(config);
  detail::check_points(points, 4, "c-M2DP");
  detail::check_colors(points, colors);
  const auto bins = detail::color_bins(colors, color_space, config);
  return count(points, bins.data(), config, threads);
}

std::vector<float> m2dp(PointsView points, const M2dpConfig& config, int threads) {
  return describe(m2dp_signature(points, config, threads), config);
}

std::vector<float> cm2dp(PointsView points, ColorsView colors, ColorSpace color_space,
                         const M2dpConfig& config, int threads) {
  return describe(cm2dp_signature(points, colors, color_space, config, threads), config);
}

}  // namespace fusionslam
