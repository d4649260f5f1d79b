// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Scan Context (Kim, Kim, IROS 2018), and the same with colour.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "../detail/checks.hpp"
#include "color_space.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/matching.hpp"

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

/// Height above the ground; it is that of no bin unless it is > 0.
float height_of(const float* point, const ScanContextConfig& config) {
  return static_cast<float>(point[2] + config.height);
}

/// CIELab a and b of each bin's points above the ground, after scaling to a grey world.
std::vector<MeanColor> mean_colors(PointsView points, ColorsView colors,
                                   const ScanContextConfig& config) {
  const detail::ByteTable scaled = detail::grey_world(colors);
  std::vector<MeanColor> means(static_cast<std::size_t>(sectors * config.rings));
  for (std::size_t i = 0; i < points.size; ++i) {
    const std::ptrdiff_t bin = bin_of(points[i], config);
    if (bin < 0 || !(height_of(points[i], config) > 0)) continue;
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
  detail::check_points(points, 1, "Scan Context");
  std::vector<float> heights(static_cast<std::size_t>(sectors * config.rings));
  bool empty = true;
  for (std::size_t i = 0; i < points.size; ++i) {
    const std::ptrdiff_t bin = bin_of(points[i], config);
    if (bin < 0) continue;
    float& highest = heights[static_cast<std::size_t>(bin)];
    const float height = height_of(points[i], config);
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
