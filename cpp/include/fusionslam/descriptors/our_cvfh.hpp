// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of our_cvfh().
struct OurCvfhConfig {
  static constexpr const char* section = "our_cvfh";

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

/// Oriented, Unique and Repeatable CVFH (regions x 308 floats; Aldoma, Tombari, Rusu, Vincze, DAGM
/// 2012), as PCL computes it: regions as in cvfh(), less the points whose normal differs more than
/// `max_angle` from the region's. Each has one semi-global frame of reference, or two or four where
/// its axes are ambiguous, and each frame a block: the three angle histograms of the CVFH (135),
/// histograms of the distances from the region's centroid in the eight octants of the frame (8 x
/// 13), and the last 69 of the 128 viewpoint bins, those of surfaces that face the origin. Octants
/// overlap by two leaves. Order, comparison and errors as cvfh().
std::vector<float> our_cvfh(PointsView points, const OurCvfhConfig& config = {}, int threads = 1);

}  // namespace fusionslam
