// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// SHOT and CSHOT as global descriptors: one keypoint, the centroid, supported by the whole cloud.
#include "../detail/checks.hpp"
#include "fusionslam/descriptors.hpp"
#include "global_shot.hpp"
#include "principal_axes.hpp"
#include "surface_normals.hpp"

namespace fusionslam {
namespace {

Normals normals_of(PointsView points, std::optional<double> normal_radius, int threads,
                   const char* name) {
  detail::check_points(points, 5, name);
  // Points on one line have normals by rounding only.
  detail::principal_axes(points, AxisSigns::largest_entry);
  if (normal_radius) detail::check_normal_radius(*normal_radius);
  const detail::PointBlocks cloud(points, threads, simd_level());
  const double radius = normal_radius ? *normal_radius : 5 * detail::resolution(cloud, threads);
  if (!normal_radius && !(radius > 0))
    throw DataError("each point of the cloud lies on another one: it has no resolution");
  Normals normals = detail::surface_normals(cloud, radius, threads);
  if (normals.indices.size() < 5)
    throw DataError(std::string(name) + " needs at least 5 points with a normal, " +
                    std::to_string(normals.indices.size()) + " have 3 neighbours within " +
                    std::to_string(radius) + " m");
  return normals;
}

}  // namespace

std::vector<float> shot(PointsView points, std::optional<double> normal_radius, int threads) {
  return detail::global_shot(points, {}, normals_of(points, normal_radius, threads, "SHOT"),
                             threads);
}

std::vector<float> cshot(PointsView points, ColorsView colors, std::optional<double> normal_radius,
                         int threads) {
  detail::check_colors(points, colors);
  return detail::global_shot(points, colors, normals_of(points, normal_radius, threads, "CSHOT"),
                             threads);
}

}  // namespace fusionslam
