// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of cospair().
struct CospairConfig {
  static constexpr const char* section = "cospair";

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

/// Global CoSPAIR (378 floats; after Logoglu, Kalkan, Temizel, Robotics and Autonomous Systems
/// 2016): the local descriptor at one keypoint, the centroid with the mean normal, its support the
/// whole downsampled cloud, as Perdomo 2019, 4.1, does for CSHOT. For each of 7 concentric shells
/// of equal width, the outermost ending at the farthest point, six histograms of 9 bins: the angles
/// theta (-pi to pi), alpha and phi (cosines, -1 to 1) between the keypoint's normal and the
/// points', then CIELab L (0 to 100), a and b (-128 to 128) of the points' colours. Each sums to 1;
/// those of a shell without points are zero. Numbers of bins and shells are not checked in the
/// paper; the division of the shells and the scale of the histograms are ours.
/// The result does not depend on `threads`. Throws as vfh, and ShapeError if there is not one
/// colour a point.
std::vector<float> cospair(PointsView points, ColorsView colors, const CospairConfig& config = {},
                           int threads = 1);

}  // namespace fusionslam
