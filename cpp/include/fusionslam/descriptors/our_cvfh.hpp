// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/descriptors/cvfh.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of our_cvfh(), those of cvfh().
struct OurCvfhConfig : CvfhConfig {
  static constexpr const char* section = "our_cvfh";
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
