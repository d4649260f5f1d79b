// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "oriented_points.hpp"

#include <string>

#include "../detail/checks.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/fusion.hpp"

namespace fusionslam::detail {
namespace {

OrientedPoints join(PointsView points, ColorsView colors, Normals&& normals) {
  OrientedPoints result;
  result.points.reserve(3 * normals.indices.size());
  for (const std::int64_t index : normals.indices) {
    const auto i = static_cast<std::size_t>(index);
    result.points.insert(result.points.end(), points[i], points[i] + 3);
    for (int channel = 0; colors.data && channel < 3; ++channel)
      result.colors.push_back(colors.at(i, channel));
  }
  result.normals = std::move(normals.normals);
  result.curvatures = std::move(normals.curvatures);
  return result;
}

}  // namespace

OrientedPoints oriented_points(PointsView points, ColorsView colors, double leaf,
                               double normal_radius, int threads, const char* name) {
  constexpr std::size_t least = 3;
  check_points(points, least, name);
  const ColoredCloud sparse = voxel_downsample(points, colors, leaf);
  const double radius = normal_radius > 0 ? normal_radius : 3 * leaf;
  OrientedPoints result;
  if (sparse.size() >= least)
    result = join(sparse.points_view(), colors.data ? sparse.colors_view() : ColorsView{},
                  estimate_normals(sparse.points_view(), radius, threads));
  if (result.size() < least)
    throw DataError(std::string(name) + " needs at least 3 points with a normal; of " +
                    count_text(sparse.size(), "point") + ", " + std::to_string(leaf) +
                    " m apart, those with 3 neighbours within " + std::to_string(radius) +
                    " m: " + std::to_string(result.size()));
  return result;
}

OrientedPoints with_new_normals(const OrientedPoints& cloud,
                                const std::vector<std::uint32_t>& indices, double normal_radius,
                                int threads) {
  if (indices.size() < 3) return {};
  std::vector<float> points;
  points.reserve(3 * indices.size());
  for (const std::uint32_t i : indices)
    points.insert(points.end(), cloud.point(i), cloud.point(i) + 3);
  const PointsView view{points.data(), indices.size()};
  return join(view, {}, estimate_normals(view, normal_radius, threads));
}

}  // namespace fusionslam::detail
