// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of ring().
struct RingConfig {
  static constexpr const char* section = "ring";

  double max_range = 70;
  double height = 2;
  double least_height = 0.5;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("max_range", config.max_range,
            OptionInfo{"half the side of the image of 120 x 120 cells; points farther from its "
                       "centre are left out",
                       "m", 1e-3, 1e6});
    visitor("height", config.height,
            OptionInfo{"height of the cloud's origin above the ground", "m", -1e6, 1e6});
    visitor("least_height", config.least_height,
            OptionInfo{"height above the ground from which points are drawn", "m", -1e6, 1e6});
  }
};

/// RING (Lu, Xu, Yin, Chen, Xiong, Wang, IROS 2022; RING++, T-RO 2023) of a cloud whose z axis
/// points up. What rises above the ground is drawn from above, 1 in cells with points; the Radon
/// transform of the image sums it along parallel lines at 120 angles, from x towards y; of each
/// angle's 120 sums the amplitudes of the frequencies 1 to 60 of the discrete Fourier transform are
/// kept (120 x 60 floats, angle after angle). The frequency 0, the number of cells, is left out: it
/// is the same at all angles. A move changes nothing but what enters and leaves the image and how
/// it falls into cells. The angles cover half a turn, because the amplitudes of the other half are
/// the same: a turn about z by 1.5 degrees moves the angles around by one, and turns that differ by
/// half a turn are not told apart. Range and numbers of cells and angles are not checked in the
/// paper. DescriptorIndex compares them with Metric::ring. Throws DataError for NaN or infinity and
/// for a cloud without a point to draw.
std::vector<float> ring(PointsView points, const RingConfig& config = {});

}  // namespace fusionslam
