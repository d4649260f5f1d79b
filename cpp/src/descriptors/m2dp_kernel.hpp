// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace fusionslam::detail {

/// Points in the cloud's own frame as three arrays, and the colour bins of each if there are any.
struct KernelCloud {
  const double* x;
  const double* y;
  const double* z;
  const std::uint8_t* color_bins;  ///< three a point, or null
  std::size_t size;
};

/// The two axes that span a projection plane.
struct KernelPlane {
  double x_axis[3];
  double y_axis[3];
};

/// Bin edges shared by all planes.
struct KernelBins {
  const double* ring_edges;      ///< squared radii of the inner edges of rings 1 .. rings - 1
  const double* sector_cosines;  ///< of the lower edge of each sector, -pi first
  const double* sector_sines;
  int rings;
  int sectors;
  int first_upper_sector;  ///< the first sector whose lower edge is at an angle >= 0
  int zero_sector;         ///< the sector of angle 0, where a point in the middle counts
  int color_bins;
};

/// Adds one vote a point (and one a point and colour channel) to the row of one plane:
/// rings x sectors shape counts, then rings x color_bins for each of three channels.
void count_votes(const KernelCloud& cloud, const KernelPlane& plane, const KernelBins& bins,
                 std::uint32_t* row);

}  // namespace fusionslam::detail
