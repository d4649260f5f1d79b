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

std::vector<float> shot_at_centroid(PointsView points, PointsView normals, ColorsView colors,
                                    int threads) {
  detail::check_points(points, 5, "SHOT");
  if (normals.size != points.size)
    throw ShapeError("normals has " + std::to_string(normals.size) + " rows, points has " +
                     std::to_string(points.size));
  if (colors.data) detail::check_colors(points, colors);
  Normals given;
  given.normals.reserve(3 * points.size);
  for (std::size_t i = 0; i < normals.size; ++i) {
    if (!detail::is_finite(normals[i]))
      throw DataError("normal " + std::to_string(i) + " is not finite");
    given.normals.insert(given.normals.end(), normals[i], normals[i] + 3);
    given.indices.push_back(static_cast<std::int64_t>(i));
  }
  return detail::global_shot(points, colors, given, threads);
}

}  // namespace fusionslam
