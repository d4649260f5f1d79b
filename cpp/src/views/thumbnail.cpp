// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "thumbnail.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

namespace fusionslam::detail {
namespace {

constexpr float column_deg = 360.0f / Thumbnail::circle;
constexpr float band_deg = 10;        // the middle band reaches from -5 to 5
constexpr float inverse_scale = 200;  // of 1 m; nearer than 0.78 m is all the same
constexpr float nearest = 0.3f;
constexpr int most_shift = 3;
// Weights of a full difference of each part, and of a turn by one column.
constexpr float inverse_weight = 2 / inverse_scale;
constexpr float share_weight = 0.5f / 255;
constexpr float color_weight = 1.0f / (3 * 255);
constexpr float shift_cost = 0.01f;
constexpr int few = 25;  // of 255: colours of a column with fewer cells say nothing

struct Sums {
  float inverse = 0, count = 0;
  std::array<float, 3> color{};
};

int column_of(float azimuth_deg) {
  const int column = static_cast<int>(std::floor(azimuth_deg / column_deg));
  return ((column % Thumbnail::circle) + Thumbnail::circle) % Thumbnail::circle;
}

int band_of(float elevation_deg) {
  return elevation_deg < -band_deg / 2 ? 0 : elevation_deg < band_deg / 2 ? 1 : 2;
}

std::uint8_t byte(float value) {
  return static_cast<std::uint8_t>(std::clamp(std::lround(value), 0l, 255l));
}

Thumbnail::Column column_from(const std::array<Sums, Thumbnail::bands>& bands, float capacity) {
  Thumbnail::Column column{};
  for (std::size_t b = 0; b < bands.size(); ++b) {
    const Sums& sums = bands[b];
    if (sums.count == 0) continue;
    column[b] = {byte(inverse_scale * sums.inverse / sums.count),
                 byte(255 * std::min(1.0f, sums.count / capacity)),
                 byte(sums.color[0] / sums.count), byte(sums.color[1] / sums.count),
                 byte(sums.color[2] / sums.count)};
  }
  return column;
}

float difference(const Thumbnail::Column& a, const Thumbnail::Column& b) {
  int inverse = 0, share = 0, color = 0;
  for (std::size_t band = 0; band < a.size(); ++band) {
    inverse += std::abs(a[band][0] - b[band][0]);
    share += std::abs(a[band][1] - b[band][1]);
    const int apart = std::abs(a[band][2] - b[band][2]) + std::abs(a[band][3] - b[band][3]) +
                      std::abs(a[band][4] - b[band][4]);
    color += std::min(a[band][1], b[band][1]) > few ? apart : 0;
  }
  return (inverse_weight * static_cast<float>(inverse) + share_weight * static_cast<float>(share) +
          color_weight * static_cast<float>(color)) /
         Thumbnail::bands;
}

}  // namespace

Thumbnail thumbnail_of(const RangeImage& image) {
  std::array<std::array<Sums, Thumbnail::bands>, Thumbnail::circle> sums{};
  std::array<bool, Thumbnail::circle> used{};
  for (const RangeImage::Cell& cell : image.cells) {
    const int column = column_of(static_cast<float>(cell.column) * image.azimuth_step);
    const int band = band_of(static_cast<float>(cell.row) * image.elevation_step);
    Sums& sum = sums[static_cast<std::size_t>(column)][static_cast<std::size_t>(band)];
    const auto range = static_cast<float>(cell.range * RangeImage::range_step);
    sum.inverse += 1 / std::max(range, nearest);
    sum.count += 1;
    for (std::size_t c = 0; c < 3; ++c) sum.color[c] += cell.color[c];
    used[static_cast<std::size_t>(column)] = true;
  }
  // In view is all but the widest gap.
  int widest = 0, after = 0, gap = 0;
  for (int i = 0; i < 2 * Thumbnail::circle; ++i) {
    if (!used[static_cast<std::size_t>(i % Thumbnail::circle)]) {
      gap = std::min(gap + 1, Thumbnail::circle);
      continue;
    }
    if (gap > widest) widest = gap, after = i % Thumbnail::circle;
    gap = 0;
  }
  Thumbnail thumbnail;
  thumbnail.first = after;
  const float capacity = column_deg / image.azimuth_step * band_deg / image.elevation_step;
  if (!image.cells.empty())
    for (int i = 0; i < Thumbnail::circle - widest; ++i)
      thumbnail.columns.push_back(
          column_from(sums[static_cast<std::size_t>((after + i) % Thumbnail::circle)], capacity));
  return thumbnail;
}

float thumbnail_distance(const Thumbnail& a, const Thumbnail& b) {
  constexpr float none = std::numeric_limits<float>::infinity();
  const int wide = static_cast<int>(a.columns.size()), other = static_cast<int>(b.columns.size());
  if (wide == 0 || other == 0) return none;
  const bool around = wide == Thumbnail::circle && other == Thumbnail::circle;
  float best = none;
  for (int shift = -most_shift; shift <= most_shift; ++shift) {
    // Column i of a lies over column i + offset of b.
    int offset =
        ((a.first - b.first + shift) % Thumbnail::circle + Thumbnail::circle) % Thumbnail::circle;
    if (!around && offset > Thumbnail::circle / 2) offset -= Thumbnail::circle;
    const int from = around ? 0 : std::max(0, -offset);
    const int to = around ? wide : std::min(wide, other - offset);
    if (2 * (to - from) < std::min(wide, other)) continue;
    float sum = 0;
    for (int i = from; i < to; ++i)
      sum += difference(a.columns[static_cast<std::size_t>(i)],
                        b.columns[static_cast<std::size_t>((i + offset) % Thumbnail::circle)]);
    best = std::min(best, sum / static_cast<float>(to - from) +
                              shift_cost * static_cast<float>(std::abs(shift)));
  }
  return best;
}

}  // namespace fusionslam::detail
