// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of intensity_scan_context().
struct IntensityScanContextConfig {
  static constexpr const char* section = "intensity_scan_context";

  double max_range = 60;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("max_range", config.max_range,
            OptionInfo{"radius of the outermost ring; points beyond are left out", "m", 1e-3, 1e6});
  }
};

/// Intensity Scan Context (Wang, Wang, Xie, ICRA 2020) of a cloud whose z axis points up, with one
/// intensity a point, finite and >= 0, in any unit: for each of 60 sectors of azimuth, from x
/// towards y, and 20 rings the largest intensity, divided by the largest within range (60 x 20
/// floats, sector after sector). Bins without points are 0; those with points are at least 1 / 255,
/// so that a dark surface is not taken for an empty bin. Intensities are taken as the scanner's
/// driver calibrates them. Numbers of bins and range are not checked in the paper. A turn about z
/// by a sector moves the sectors by one. DescriptorIndex compares them with
/// Metric::intensity_scan_context. Throws ShapeError if there is not one
/// intensity a point; DataError for NaN or infinity, negative intensities, and if no point within
/// `max_range` has an intensity > 0.
std::vector<float> intensity_scan_context(PointsView points, std::span<const float> intensities,
                                          const IntensityScanContextConfig& config = {});

}  // namespace fusionslam
