// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

/// Points that have a normal.
struct OrientedPoints {
  std::vector<float> points;         ///< x, y, z in metres
  std::vector<float> normals;        ///< unit length, turned towards the origin
  std::vector<float> curvatures;     ///< smallest eigenvalue over the sum of all three
  std::vector<std::uint8_t> colors;  ///< R, G, B; empty if the cloud has no colours

  std::size_t size() const { return curvatures.size(); }
  const float* point(std::size_t i) const { return points.data() + 3 * i; }
  const float* normal(std::size_t i) const { return normals.data() + 3 * i; }
  PointsView points_view() const { return {points.data(), size()}; }
};

/// The means of the points in cubes of side `leaf` that have a normal within `normal_radius` metres
/// (0: three leaves). Without colours `colors` is empty. Throws DataError, which begins with
/// `name`, if there are fewer than three, and as voxel_downsample and estimate_normals.
OrientedPoints oriented_points(PointsView points, ColorsView colors, double leaf,
                               double normal_radius, int threads, const char* name);

/// The points of the cloud with these indices, with normals computed of these alone; those that
/// have none are left out.
OrientedPoints with_new_normals(const OrientedPoints& cloud,
                                const std::vector<std::uint32_t>& indices, double normal_radius,
                                int threads);

}  // namespace fusionslam::detail
