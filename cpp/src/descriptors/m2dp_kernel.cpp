// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The hot loop of M2DP: every point against every plane. Rings are found by comparing squared
// radii and sectors by the side of a precomputed direction, without sqrt or atan2.
#include "m2dp_kernel.hpp"

namespace fusionslam::detail {
namespace {

int ring_of(double squared_radius, const KernelBins& bins) {
  int ring = 0;
  for (int i = 0; i < bins.rings - 1; ++i) ring += squared_radius >= bins.ring_edges[i];
  return ring;
}

/// Only edges in the point's own half-plane are compared, where the sign of the cross product
/// orders angles.
int sector_of(double x, double y, const KernelBins& bins) {
  if (x == 0 && y == 0) return bins.zero_sector;
  const bool lower = y < 0;
  const int begin = lower ? 0 : bins.first_upper_sector;
  const int end = lower ? bins.first_upper_sector : bins.sectors;
  int passed = begin;
  for (int i = begin; i < end; ++i)
    passed += bins.sector_cosines[i] * y - bins.sector_sines[i] * x >= 0;
  return passed > 0 ? passed - 1 : 0;
}

}  // namespace

void count_votes(const KernelCloud& cloud, const KernelPlane& plane, const KernelBins& bins,
                 std::uint32_t* row) {
  std::uint32_t* colors = row + bins.rings * bins.sectors;
  const int channel_columns = bins.rings * bins.color_bins;
  for (std::size_t i = 0; i < cloud.size; ++i) {
    const double x =
        cloud.x[i] * plane.x_axis[0] + cloud.y[i] * plane.x_axis[1] + cloud.z[i] * plane.x_axis[2];
    const double y =
        cloud.x[i] * plane.y_axis[0] + cloud.y[i] * plane.y_axis[1] + cloud.z[i] * plane.y_axis[2];
    const int ring = ring_of(x * x + y * y, bins);
    ++row[ring * bins.sectors + sector_of(x, y, bins)];
    if (cloud.color_bins == nullptr) continue;
    std::uint32_t* histogram = colors + ring * bins.color_bins;
    for (int channel = 0; channel < 3; ++channel)
      ++histogram[channel * channel_columns +
                  cloud.color_bins[i * 3 + static_cast<std::size_t>(channel)]];
  }
}

}  // namespace fusionslam::detail
