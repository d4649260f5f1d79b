// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// GASD with colour (984 floats; Lima, Teichrieb, SIBGRAPI 2016), as PCL computes it: in the frame
/// of the cloud's principal axes, z the shortest of them and pointing towards -z of the cloud,
/// counts in 6 x 6 x 6 cells of the bounding cube about the centroid (x slowest), then of 4 x 4 x 4
/// cells histograms of the hue in 12 bins; each part in percent of the points (less one), of which
/// the one that sets the size of the cube may fall on its far side and is not counted. The sign of
/// x, which PCL leaves to rounding, is that of the third moment, so that turns about z and shifts
/// change only the cells of points next to a border. Throws as cm2dp.
std::vector<float> gasd_color(PointsView points, ColorsView colors);

}  // namespace fusionslam
