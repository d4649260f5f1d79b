// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of cvfh().
struct CvfhConfig {
  static constexpr const char* section = "cvfh";

  double leaf = 0.3;
  double normal_radius = 0;
  int regions = 8;
  int min_points = 50;
  double max_curvature = 0.03;
  double max_angle = 0.125;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor(
        "leaf", config.leaf,
        OptionInfo{"side of the cubes whose points are replaced by their mean", "m", 1e-3, 1e3});
    visitor("normal_radius", config.normal_radius,
            OptionInfo{"radius of the neighbourhood of a normal; 0 is three leaves", "m", 0, 1e3});
    visitor("regions", config.regions, OptionInfo{"how many blocks of 308 there are", "", 1, 64});
    visitor("min_points", config.min_points,
            OptionInfo{"points of the smallest region", "", 3, 1000000});
    visitor("max_curvature", config.max_curvature,
            OptionInfo{"points with a larger curvature belong to no region", "", 0, 1});
    visitor(
        "max_angle", config.max_angle,
        OptionInfo{"largest angle between the normals of neighbours in a region", "rad", 1e-3, 3});
  }
};

/// Clustered Viewpoint Feature Histogram (regions x 308 floats; Aldoma et al., ICCV Workshops
/// 2011), as PCL computes it: points of low curvature of the downsampled cloud, nearer to each
/// other than three leaves and with similar normals, form smooth regions; of each, a block holds
/// the VFH of the whole cloud about the region's centroid and mean normal, each histogram summing
/// to about 100. Blocks follow each other from the largest region downwards; those without a region
/// are zero. Compared as sets of regions. The result does not depend on `threads`. Throws as vfh,
/// and DataError if there is no region.
std::vector<float> cvfh(PointsView points, const CvfhConfig& config = {}, int threads = 1);

}  // namespace fusionslam
