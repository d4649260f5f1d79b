// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Scan Context (Kim, Kim, IROS 2018).
#include <algorithm>
#include <cmath>
#include <numbers>

#include "../detail/checks.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/matching.hpp"

namespace fusionslam {
namespace {

constexpr int sectors = static_cast<int>(scan_context_sectors);

/// The bin of a point, or -1 beyond the outermost ring.
std::ptrdiff_t bin_of(const float* point, const ScanContextConfig& config) {
  const double x = point[0], y = point[1];
  const double ring = std::sqrt(x * x + y * y) / config.max_range * config.rings;
  if (!(ring < config.rings)) return -1;
  const double turn = std::atan2(y, x) / (2 * std::numbers::pi);
  const double sector = std::floor((turn < 0 ? turn + 1 : turn) * sectors);
  return static_cast<std::ptrdiff_t>(std::min<double>(sector, sectors - 1)) * config.rings +
         static_cast<std::ptrdiff_t>(ring);
}

}  // namespace

std::vector<float> scan_context(PointsView points, const ScanContextConfig& config) {
  validate(config);
  detail::check_points(points, 1, "Scan Context");
  std::vector<float> heights(static_cast<std::size_t>(sectors * config.rings));
  bool empty = true;
  for (std::size_t i = 0; i < points.size; ++i) {
    const std::ptrdiff_t bin = bin_of(points[i], config);
    if (bin < 0) continue;
    float& highest = heights[static_cast<std::size_t>(bin)];
    const auto height = static_cast<float>(points[i][2] + config.height);
    if (!(height > highest)) continue;
    highest = height;
    empty = false;
  }
  if (empty)
    throw DataError(
        "Scan Context: the cloud has no point above the ground within scan_context."
        "max_range, which is " +
        std::to_string(config.max_range) + " m");
  return heights;
}

}  // namespace fusionslam
