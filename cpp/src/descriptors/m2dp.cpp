// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// M2DP (He, Wang, Zhang, IROS 2016) and c-M2DP (Perdomo 2019, chapter 3).
#include <cmath>

#include "../detail/checks.hpp"
#include "cloud_axes.hpp"
#include "color_space.hpp"
#include "fusionslam/descriptors.hpp"
#include "matrix_kernel.hpp"
#include "mirror_pairs.hpp"
#include "moments_kernel.hpp"
#include "projection_planes.hpp"
#include "singular_vectors.hpp"
#include "votes.hpp"

namespace fusionslam {
namespace {

detail::RawPoints raw(PointsView points) { return {points.data, points.stride, points.size}; }

double farthest_distance(PointsView points, const detail::KernelFrame& frame) {
  const auto kernel = detail::moments_kernel(simd_level());
  return std::sqrt(kernel.largest_squared(raw(points), frame, 0));
}

/// The cloud's own frame with its outer radius as unit.
detail::KernelFrame unit_frame(PointsView points, const M2dpConfig& config) {
  const auto own = config.axes == CloudAxes::upright
                       ? detail::upright_axes(points)
                       : detail::principal_axes(points, config.axis_signs);
  detail::KernelFrame frame{};
  for (int row = 0; row < 3; ++row) {
    frame.origin[row] = own.mean[row];
    for (int column = 0; column < 3; ++column) frame.rows[row][column] = own.axes(row, column);
  }
  const double radius = config.outer_radius == OuterRadius::farthest_point
                            ? farthest_distance(points, frame)
                            : 3 * std::sqrt(own.mean_square);
  for (auto& row : frame.rows)
    for (double& value : row) value /= radius;
  return frame;
}

void check(const M2dpConfig& config) {
  validate(config);
  if (config.axis_signs == AxisSigns::mirror_pairs && config.azimuths % 4 != 0)
    throw ConfigError("m2dp.azimuths is " + std::to_string(config.azimuths) +
                      ", expected a multiple of 4 with axis_signs = mirror_pairs");
  if (config.axis_signs == AxisSigns::mirror_pairs && config.sectors % 2 != 0)
    throw ConfigError("m2dp.sectors is " + std::to_string(config.sectors) +
                      ", expected an even number with axis_signs = mirror_pairs");
}

/// The signature before its division by the number of points; `colors` is null for M2DP.
Signature votes(PointsView points, const detail::ColorBinner* colors, const M2dpConfig& config,
                int threads) {
  const bool mirrored = config.axis_signs == AxisSigns::mirror_pairs;
  const auto planes = mirrored ? detail::mirrored_planes(config.azimuths, config.elevations)
                               : detail::grid_planes(config.azimuths, config.elevations);
  detail::VoteTask task{raw(points), unit_frame(points, config), colors};
  task.points.size -= config.drop_last_point ? 1 : 0;
  Signature signature = detail::count_votes(task, planes, config, simd_level(), threads);
  if (mirrored && config.axes == CloudAxes::principal)
    detail::sort_mirror_pairs(config, planes, signature);
  return signature;
}

Signature m2dp_votes(PointsView points, const M2dpConfig& config, int threads) {
  check(config);
  detail::check_size(points, 4, "M2DP");
  return votes(points, nullptr, config, threads);
}

Signature cm2dp_votes(PointsView points, ColorsView colors, ColorSpace color_space,
                      const M2dpConfig& config, int threads) {
  check(config);
  detail::check_size(points, 4, "c-M2DP");
  detail::check_colors(points, colors);
  const detail::ColorBinner binner(colors, color_space, config);
  return votes(points, &binner, config, threads);
}

Signature divide(Signature votes, std::size_t points) {
  for (double& value : votes.values) value /= static_cast<double>(points);
  return votes;
}

/// Singular vectors do not depend on scale, so votes need not be divided.
std::vector<float> describe(const Signature& votes, const M2dpConfig& config) {
  const auto kernel = detail::matrix_kernel(simd_level());
  const bool roots = config.weighting == Weighting::square_root;
  std::vector<float> matrix(votes.values.size());
  (roots ? kernel.square_roots : kernel.convert)(votes.values.data(), matrix.size(), matrix.data());
  return detail::singular_vectors({matrix.data(), votes.rows, votes.columns}).joined;
}

}  // namespace

M2dpConfig m2dp_preset(std::string_view name) {
  M2dpConfig config;
  if (name == "upright") config.axes = CloudAxes::upright;
  if (name == "robust" || name == "upright") return config;
  if (name != "paper" && name != "author")
    throw ConfigError("preset is '" + std::string(name) +
                      "', expected one of paper, author, robust, upright");
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
  return divide(m2dp_votes(points, config, threads), points.size);
}

Signature cm2dp_signature(PointsView points, ColorsView colors, ColorSpace color_space,
                          const M2dpConfig& config, int threads) {
  return divide(cm2dp_votes(points, colors, color_space, config, threads), points.size);
}

std::vector<float> m2dp(PointsView points, const M2dpConfig& config, int threads) {
  return describe(m2dp_votes(points, config, threads), config);
}

std::vector<float> cm2dp(PointsView points, ColorsView colors, ColorSpace color_space,
                         const M2dpConfig& config, int threads) {
  return describe(cm2dp_votes(points, colors, color_space, config, threads), config);
}

}  // namespace fusionslam
