// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace fusionslam::detail {

/// Sectors of azimuth, from x towards y, each divided into rings of one width about the origin.
struct PolarGrid {
  int sectors;
  int rings;
  double max_range;  ///< metres

  std::size_t size() const { return static_cast<std::size_t>(sectors) * rings; }

  /// The bin of a point, sector after sector and outwards, or -1 beyond the outermost ring.
  std::ptrdiff_t bin_of(const float* point) const {
    const double x = point[0], y = point[1];
    const double ring = std::sqrt(x * x + y * y) / max_range * rings;
    if (!(ring < rings)) return -1;
    const double turn = std::atan2(y, x) / (2 * std::numbers::pi);
    const double sector = std::floor((turn < 0 ? turn + 1 : turn) * sectors);
    return static_cast<std::ptrdiff_t>(std::min<double>(sector, sectors - 1)) * rings +
           static_cast<std::ptrdiff_t>(ring);
  }
};

}  // namespace fusionslam::detail
