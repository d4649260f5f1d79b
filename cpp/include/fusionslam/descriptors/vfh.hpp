// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of vfh().
struct VfhConfig {
  static constexpr const char* section = "vfh";

  double leaf = 0.3;
  double normal_radius = 0;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor(
        "leaf", config.leaf,
        OptionInfo{"side of the cubes whose points are replaced by their mean", "m", 1e-3, 1e3});
    visitor("normal_radius", config.normal_radius,
            OptionInfo{"radius of the neighbourhood of a normal; 0 is three leaves", "m", 0, 1e3});
  }
};

/// Viewpoint Feature Histogram (308 floats) of a cloud seen from its origin (Rusu, Bradski,
/// Thibaux, Hsu, IROS 2010, section III), binned as in PCL: over the points of the downsampled
/// cloud, 45 bins for each of the three angles between the mean normal at the centroid and the
/// point's normal (theta, alpha, phi), 45 of the distance from the centroid over the farthest
/// one's, 128 of the angle between the normal and the direction from the centroid to the origin.
/// Each histogram sums to about 100, and no entry is negative. Like PCL, it bins cosines of alpha
/// and phi as if they were angles from -pi to pi, of which they fill the middle third. Turns about
/// the origin change it only as far as they change the downsampled cloud. The result does not
/// depend on `threads`. Throws DataError for NaN or infinity, and for fewer than 3 points with a
/// normal.
std::vector<float> vfh(PointsView points, const VfhConfig& config = {}, int threads = 1);

}  // namespace fusionslam
