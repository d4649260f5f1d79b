// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Intensity Scan Context (Wang, Wang, Xie, ICRA 2020).
#include "fusionslam/descriptors/intensity_scan_context.hpp"

#include <algorithm>
#include <string>

#include "../detail/checks.hpp"
#include "fusionslam/matching.hpp"
#include "polar_grid.hpp"

namespace fusionslam {
namespace {

constexpr int sectors = static_cast<int>(scan_context_sectors);
constexpr int rings = 20;

/// Least value of a bin with points: a step of 8-bit intensities.
constexpr float darkest = 1.0F / 255;

}  // namespace

std::vector<float> intensity_scan_context(PointsView points, std::span<const float> intensities,
                                          const IntensityScanContextConfig& config) {
  validate(config);
  detail::check_points(points, 1, "intensity_scan_context");
  detail::check_intensities(points, intensities);
  const detail::PolarGrid grid{sectors, rings, config.max_range};
  constexpr float empty = -1;
  std::vector<float> context(grid.size(), empty);
  for (std::size_t i = 0; i < points.size; ++i) {
    const std::ptrdiff_t bin = grid.bin_of(points[i]);
    if (bin < 0) continue;
    float& brightest = context[static_cast<std::size_t>(bin)];
    brightest = std::max(brightest, intensities[i]);
  }
  const float most = std::ranges::max(context);
  if (!(most > 0))
    throw DataError(
        "intensity_scan_context: no point within intensity_scan_context.max_range, which is " +
        std::to_string(config.max_range) + " m, has an intensity > 0");
  for (float& value : context) value = value == empty ? 0 : std::max(value / most, darkest);
  return context;
}

}  // namespace fusionslam
