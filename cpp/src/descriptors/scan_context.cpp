// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Scan Context (Kim, Kim, IROS 2018), and the same with colour.
#include <algorithm>
#include <cmath>

#include "../detail/checks.hpp"
#include "color_space.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/matching.hpp"
#include "highest_points.hpp"
#include "polar_grid.hpp"

namespace fusionslam {
namespace {

constexpr int sectors = static_cast<int>(scan_context_sectors);

/// Chroma at which a colour counts half: without it, noise would choose the hue of greys.
constexpr double faint_chroma = 5;

/// Brings what colours weigh to what heights weigh, in outdoor scenes.
constexpr double color_weight = 2;

struct MeanColor {
  double a = 0, b = 0;
  std::size_t points = 0;
};

detail::PolarGrid grid_of(const ScanContextConfig& config) {
  return {sectors, config.rings, config.max_range};
}

/// CIELab a and b of each bin's points above the ground, after scaling to a grey world.
std::vector<MeanColor> mean_colors(PointsView points, ColorsView colors,
                                   const ScanContextConfig& config) {
  const detail::ByteTable scaled = detail::grey_world(colors);
  const detail::PolarGrid grid = grid_of(config);
  std::vector<MeanColor> means(grid.size());
  for (std::size_t i = 0; i < points.size; ++i) {
    const std::ptrdiff_t bin = grid.bin_of(points[i]);
    if (bin < 0 || !(detail::height_above_ground(points[i], config.height) > 0)) continue;
    const auto byte = [&](std::size_t c) { return scaled[c][colors.at(i, static_cast<int>(c))]; };
    const auto lab = detail::lab_from_rgb(byte(0), byte(1), byte(2), false);
    MeanColor& mean = means[static_cast<std::size_t>(bin)];
    mean.a += 255 * lab[1] - 128;
    mean.b += 255 * lab[2] - 128;
    ++mean.points;
  }
  for (MeanColor& mean : means) {
    mean.a /= static_cast<double>(std::max<std::size_t>(mean.points, 1));
    mean.b /= static_cast<double>(std::max<std::size_t>(mean.points, 1));
  }
  return means;
}

/// Root mean square of the heights of the bins that have points.
double root_mean_square(const std::vector<float>& heights) {
  double sum = 0;
  for (const float height : heights) sum += static_cast<double>(height) * height;
  const auto empty = static_cast<double>(std::ranges::count(heights, 0.0F));
  return std::sqrt(sum / (static_cast<double>(heights.size()) - empty));
}

}  // namespace

std::vector<float> scan_context(PointsView points, const ScanContextConfig& config) {
  validate(config);
  return detail::highest_points(points, config.height, grid_of(config), "Scan Context",
                                ScanContextConfig::section);
}

std::vector<float> cscan_context(PointsView points, ColorsView colors,
                                 const ScanContextConfig& config) {
  detail::check_colors(points, colors);
  const std::vector<float> heights = scan_context(points, config);
  const std::vector<MeanColor> means = mean_colors(points, colors, config);
  const double unit = root_mean_square(heights);
  std::vector<float> context(3 * heights.size());
  for (std::size_t bin = 0; bin < heights.size(); ++bin) {
    const auto rings = static_cast<std::size_t>(config.rings);
    float* value = context.data() + 3 * (bin - bin % rings) + bin % rings;
    const double weight = color_weight / (std::hypot(means[bin].a, means[bin].b) + faint_chroma);
    value[0] = static_cast<float>(heights[bin] / unit);
    value[rings] = static_cast<float>(weight * means[bin].a);
    value[2 * rings] = static_cast<float>(weight * means[bin].b);
  }
  return context;
}

}  // namespace fusionslam
