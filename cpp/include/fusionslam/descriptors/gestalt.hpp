// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of gestalt().
struct GestaltConfig {
  static constexpr const char* section = "gestalt";

  double leaf = 0.5;
  int keypoints = 100;
  double radius = 10;
  int min_points = 30;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor(
        "leaf", config.leaf,
        OptionInfo{"side of the cubes whose points are replaced by their mean", "m", 1e-3, 1e3});
    visitor("keypoints", config.keypoints,
            OptionInfo{"how many keypoints there are at most", "", 1, 10000});
    visitor("radius", config.radius,
            OptionInfo{"radius of the vertical cylinder about a keypoint", "m", 1e-2, 1e3});
    visitor("min_points", config.min_points,
            OptionInfo{"points that a keypoint needs in its cylinder", "", 3, 1000000});
  }
};

/// 3D Gestalt descriptors (keypoints x 66 floats) of a cloud whose z axis points up (Bosse, Zlot,
/// ICRA 2013, as Perdomo 2019, 2.6, sums them up): keypoints are drawn from the downsampled cloud
/// by a generator with a fixed seed; about each, a vertical cylinder is split into 4 rings of equal
/// width and 8 sectors, the first of which begins at the horizontal principal axis of the points in
/// it, on the side where their third moment is positive. A block holds the mean height above the
/// keypoint in each of the 32 bins (m, ring after ring), the variance of the heights in each (m^2),
/// then the keypoint's x and y (m). Bins without a point are zero; blocks without a keypoint, which
/// come last, too. The first 64 values do not depend on where the cloud's origin is, nor on turns
/// about z. The numbers of rings and sectors and the axis are not in that summary and not checked
/// in the paper; leaf, radius, numbers of keypoints and points, and empty bins are ours. Throws
/// DataError for NaN or infinity, and for a cloud without a keypoint.
std::vector<float> gestalt(PointsView points, const GestaltConfig& config = {}, int threads = 1);

}  // namespace fusionslam
