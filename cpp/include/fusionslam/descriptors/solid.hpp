// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/matching.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of solid(). Elevations are angles above the horizon of the cloud's origin; those of
/// the defaults hold what common spinning scanners see. The voxel is the paper's.
struct SolidConfig {
  static constexpr const char* section = "solid";

  double max_range = 80;
  double voxel = 0.5;
  int elevations = 32;
  double lowest_elevation = -25;
  double highest_elevation = 15;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("max_range", config.max_range,
            OptionInfo{"horizontal range of the farthest bin; points beyond are left out", "m",
                       1e-3, 1e6});
    visitor(
        "voxel", config.voxel,
        OptionInfo{"side of the cubes whose points are replaced by their mean", "m", 1e-3, 1e6});
    visitor("elevations", config.elevations, OptionInfo{"bins of elevation", "", 1, 1000});
    visitor("lowest_elevation", config.lowest_elevation,
            OptionInfo{"where the lowest bin of elevation begins; points below are left out",
                       "degrees", -90, 90});
    visitor("highest_elevation", config.highest_elevation,
            OptionInfo{"where the highest bin of elevation ends; points above are left out",
                       "degrees", -90, 90});
  }
};

/// Both parts of SOLiD. Their numbers of bins are not checked in the paper.
struct SolidParts {
  std::vector<float> ranges;    ///< R-SOLiD: of 40 bins of horizontal range, outwards
  std::vector<float> azimuths;  ///< A-SOLiD: of 60 bins of azimuth, from x towards y
};

/// SOLiD (Kim, Choi, Sim, Kim, Cho, RA-L 2024) of a cloud whose z axis points up and whose origin
/// is the scanner. The mean points of voxels are counted over range and elevation, and over azimuth
/// and elevation. A bin of elevation weighs its count, scaled so that the fullest one weighs 1 and
/// the emptiest 0 (each 1 if all are equal); the parts are the sums over elevation of weight times
/// count. A turn about z leaves the ranges and shifts the azimuths, as far as voxels allow. The
/// scale of the weights is not checked in the paper.
/// Throws DataError for NaN or infinity and for a cloud without a point within range and
/// elevations, ConfigError if the lowest elevation is not below the highest.
SolidParts solid_parts(PointsView points, const SolidConfig& config = {});

/// The ranges alone, scaled to length 1 (40 floats), so that Metric::l2 orders them as the paper's
/// cosine does. Throws as solid_parts.
std::vector<float> solid(PointsView points, const SolidConfig& config = {});

/// The turn between two clouds from the azimuths of their parts (60 floats each): the shift with
/// the least sum of absolute differences, which is the distance. Of equal ones the first counts.
/// Throws ShapeError for other lengths, DataError for NaN or infinity.
TurnedMatch compare_solid_azimuths(std::span<const float> query, std::span<const float> match);

}  // namespace fusionslam
