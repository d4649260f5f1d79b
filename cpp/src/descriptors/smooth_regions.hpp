// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "vfh_histogram.hpp"

namespace fusionslam::detail {

struct RegionRule {
  double leaf;           ///< neighbours are nearer than three of them
  double normal_radius;  ///< metres; 0 is three leaves
  int min_points;
  double max_curvature;
  double max_angle;  ///< between the normals of neighbours, rad

  double tolerance() const { return 3 * leaf; }
  double radius() const { return normal_radius > 0 ? normal_radius : 3 * leaf; }
};

/// The smooth parts of a cloud: its points of low curvature, with normals of these alone, and
/// the connected components of the graph in which neighbours with similar normals are joined.
struct SmoothRegions {
  OrientedPoints points;
  std::vector<std::vector<std::uint32_t>> regions;  ///< places of points, the largest region first
};

/// Throws DataError, which begins with `name`, if there is no region.
SmoothRegions smooth_regions(const OrientedPoints& cloud, const RegionRule& rule, int threads,
                             const char* name);

/// Mean point and mean normal, of length 1, of the points of a region.
VfhCenter region_center(const OrientedPoints& points, const std::vector<std::uint32_t>& region);

}  // namespace fusionslam::detail
