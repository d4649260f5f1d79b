// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of ndt_histogram().
struct NdtHistogramConfig {
  static constexpr const char* section = "ndt_histogram";

  double cell = 1;
  double evenness = 0.1;
  double ambiguity = 0.6;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("cell", config.cell,
            OptionInfo{"side of the cells whose points are taken for one surface", "m", 1e-3, 1e6});
    visitor("evenness", config.evenness,
            OptionInfo{"ratio of two eigenvalues up to which the smaller one counts as none", "", 0,
                       1});
    visitor("ambiguity", config.ambiguity,
            OptionInfo{"share of the most common direction of walls from which the second one is "
                       "aligned too",
                       "", 0, 1});
  }
};

/// Surface-shape histograms over the normal distributions transform (Magnusson, Andreasson,
/// Nüchter, Lilienthal, ICRA 2009 and Journal of Field Robotics 2009) of a cloud whose z axis
/// points up and whose origin is the scanner. The points of each cell, 5 or more, have a covariance
/// with eigenvalues l1 <= l2 <= l3: the cell is a line if l2 <= evenness l3, else a plane if l1 <=
/// evenness l2, else round. Cells are counted in 11 classes (1 of lines, 9 of planes by the
/// direction nearest to their normal, 1 round) in each of the shells of distance 0, 3, 6, 9 and
/// 15 m and farther; a histogram is scaled to the sum 1 (55 floats: of each shell the line, the
/// planes - level, walls towards 0, 45, 90 and 135 degrees, slopes of 45 degrees towards 0, 90, 180
/// and 270 - and the round ones).
/// What turns about z do not change is the set of up to four histograms (4 x 55 floats, unused ones
/// 0), each of the cloud turned so that a common direction of walls comes to lie along x: the
/// commonest, both ways, and, if it has the share `ambiguity` of the commonest, the next. Without
/// walls there is one histogram, of the cloud as it is. The paper aligns two planes in three
/// dimensions; here the vertical is known. Classes, shells and defaults are not checked in the
/// paper. DescriptorIndex compares them with
/// Metric::nearest_of_set. Throws DataError for NaN or infinity and for a cloud without a cell of 5
/// points.
std::vector<float> ndt_histogram(PointsView points, const NdtHistogramConfig& config = {});

}  // namespace fusionslam
