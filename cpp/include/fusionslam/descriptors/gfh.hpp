// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of gfh().
struct GfhConfig {
  static constexpr const char* section = "gfh";

  int sectors = 60;
  int rings = 20;
  int layers = 8;
  double max_range = 80;
  double bottom = -3;
  double top = 13;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("sectors", config.sectors, OptionInfo{"bins of azimuth", "", 2, 3600});
    visitor("rings", config.rings,
            OptionInfo{"bins of the distance from the vertical axis", "", 1, 1000});
    visitor("layers", config.layers, OptionInfo{"bins of height", "", 1, 1000});
    visitor("max_range", config.max_range,
            OptionInfo{"radius of the outermost ring; points beyond are left out", "m", 1e-3, 1e6});
    visitor("bottom", config.bottom,
            OptionInfo{"height at which the lowest layer begins; points below are left out", "m",
                       -1e6, 1e6});
    visitor("top", config.top,
            OptionInfo{"height at which the highest layer ends; points above are left out", "m",
                       -1e6, 1e6});
  }
};

/// Global Fourier Histogram (Chen et al. 2014, as Perdomo 2019, 2.6, sums it up) of a cloud whose z
/// axis points up, about its origin: points are counted in rings x layers x sectors of a cylinder;
/// of each ring and layer it holds the amplitudes of the Fourier transform of the counts over
/// azimuth, of 0, 1, ... sectors / 2 periods (ring after ring, of each the layers from the lowest
/// upwards: rings x layers x (sectors / 2 + 1) floats), all scaled to length 1. Turns about z by
/// whole sectors do not change it; shifts do. The paper describes objects. The numbers of bins, the
/// cylinder, that amplitudes are kept, and their scale are ours. Throws DataError for NaN or
/// infinity and for a cloud without a point in the cylinder, ConfigError if the top is not above
/// the bottom.
std::vector<float> gfh(PointsView points, const GfhConfig& config = {});

}  // namespace fusionslam
