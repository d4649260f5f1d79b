// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of iris(). Heights are those of the cloud, whose origin is the scanner.
struct IrisConfig {
  static constexpr const char* section = "iris";

  double max_range = 80;
  double lowest = -3;
  double highest = 5;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("max_range", config.max_range,
            OptionInfo{"radius of the outermost of 80 rings; points beyond are left out", "m", 1e-3,
                       1e6});
    visitor(
        "lowest", config.lowest,
        OptionInfo{"z where the lowest slice begins; points below are left out", "m", -1e6, 1e6});
    visitor("highest", config.highest,
            OptionInfo{"z where the highest slice ends; points from there on are left out", "m",
                       -1e6, 1e6});
  }
};

/// LiDAR-Iris image of a cloud whose z axis points up (Wang, Sun, Xu, Sarma, Yang, Kong, IROS
/// 2020): for each of 80 rings, outwards, and 360 columns of azimuth, from x towards y, a byte
/// whose bit i is set if there is a point in slice i, upwards, of 8 equal ones (ring after ring, 80
/// x 360 bytes). Numbers of rings and columns, range and heights are not checked in the paper.
/// Throws DataError for NaN or infinity and for a cloud without a point within range and slices,
/// ConfigError if `lowest` is not below `highest`.
std::vector<std::uint8_t> iris_image(PointsView points, const IrisConfig& config = {});

/// LiDAR Iris: the signs of what four LoG-Gabor filters along azimuth make of the image. Column
/// after column of azimuth 40 words of code, then 40 of mask, each a whole number from 0 to 65535
/// (360 x 80 floats). Bit 8 (ring % 2) + 2 filter + part of word ring / 2 of the code is set if the
/// real (part 0) or imaginary part (1) of the filter's response is > 0; that of the mask is set if
/// the bit counts: where the response is weaker than 1e-4 of a byte's range, as in an empty ring,
/// its sign says nothing. Wavelengths and bandwidth are not checked in the paper, and that
/// threshold is ours. A turn about z by a degree moves the columns by one. DescriptorIndex compares
/// them with Metric::iris. Throws as iris_image.
std::vector<float> iris(PointsView points, const IrisConfig& config = {});

}  // namespace fusionslam
