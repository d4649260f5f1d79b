// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of scan_context_polar().
struct ScanContextPolarConfig {
  static constexpr const char* section = "scan_context_polar";

  double max_range = 80;
  double height = 2;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("max_range", config.max_range,
            OptionInfo{"radius of the outermost ring; points beyond are left out", "m", 1e-3, 1e6});
    visitor("height", config.height,
            OptionInfo{"height of the cloud's origin above the ground, added to every point", "m",
                       -1e6, 1e6});
  }
};

/// Polar Context of Scan Context++ (Kim, Choi, Kim, T-RO 2022) of a cloud whose z axis
/// points up: the rows of scan_context() with 20 rings, for 60 sectors the heights of their
/// highest points (60 x 20 floats, sector after sector). What is new is how two are compared:
/// DescriptorIndex does so with Metric::aligned_polar. A turn about z by a sector moves the
/// sectors by one. Throws DataError for NaN or infinity and for a cloud without a point above the
/// ground within `max_range`.
std::vector<float> scan_context_polar(PointsView points, const ScanContextPolarConfig& config = {});

/// Parameters of scan_context_cartesian().
struct ScanContextCartesianConfig {
  static constexpr const char* section = "scan_context_cartesian";

  double lateral_range = 40;
  double longitudinal_range = 100;
  double height = 2;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("lateral_range", config.lateral_range,
            OptionInfo{"how far to the left and to the right columns reach", "m", 1e-3, 1e6});
    visitor("longitudinal_range", config.longitudinal_range,
            OptionInfo{"how far ahead and back rows reach", "m", 1e-3, 1e6});
    visitor("height", config.height,
            OptionInfo{"height of the cloud's origin above the ground, added to every point", "m",
                       -1e6, 1e6});
  }
};

/// Cartesian Context of Scan Context++ (Kim, Choi, Kim, T-RO 2022) of a cloud whose x
/// axis points ahead and z up: the height above the ground of the highest point of each of 40 x 40
/// cells, 0 without one (40 columns from -lateral_range to lateral_range along y, one after the
/// other, each with 40 cells from -longitudinal_range to longitudinal_range along x: 1600 floats).
/// A move to the side by the width of a column, 2 m with the defaults, moves the columns by one;
/// half a turn about z reverses the floats. Range and resolution are the paper's (table II), which
/// first replaces the points in cubes of 0.5 m by one. DescriptorIndex compares them with
/// Metric::aligned_cartesian. Throws DataError for NaN or infinity and for a cloud without a point
/// above the ground within range.
std::vector<float> scan_context_cartesian(PointsView points,
                                          const ScanContextCartesianConfig& config = {});

}  // namespace fusionslam
