// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// CoSPAIR (Logoglu, Kalkan, Temizel, Robotics and Autonomous Systems 2016) at the centroid.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "../detail/checks.hpp"
#include "color_space.hpp"
#include "fusionslam/descriptors.hpp"
#include "vfh_histogram.hpp"

namespace fusionslam {
namespace {

constexpr std::size_t shells = 7;
constexpr std::size_t bins = 9;
constexpr std::size_t histograms = 6;  ///< of a shell: theta, alpha, phi, L, a, b

/// Values are counted from `low` to `high`.
struct Range {
  double low, high;
};
constexpr std::array<Range, histograms> ranges{
    {{-std::numbers::pi, std::numbers::pi}, {-1, 1}, {-1, 1}, {0, 100}, {-128, 128}, {-128, 128}}};

std::size_t bin_of(double value, std::size_t histogram) {
  const auto [low, high] = ranges[histogram];
  const double bin = std::floor((value - low) / (high - low) * bins);
  return static_cast<std::size_t>(std::clamp(bin, 0.0, bins - 1.0));
}

using Counts = std::array<std::uint32_t, shells * histograms * bins>;

detail::Vector3 offset(const float* point, const detail::VfhCenter& center) {
  return {point[0] - center.point[0], point[1] - center.point[1], point[2] - center.point[2]};
}

float length(const detail::Vector3& v) { return std::sqrt(detail::dot(v.data(), v.data())); }

Counts count(const detail::OrientedPoints& cloud, const detail::VfhCenter& center) {
  float farthest = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i)
    farthest = std::max(farthest, length(offset(cloud.point(i), center)));
  if (!(farthest > 0)) throw DataError("CoSPAIR: all points of the cloud are equal");
  Counts counts{};
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const detail::Vector3 from_center = offset(cloud.point(i), center);
    const auto shell = std::min(
        static_cast<std::size_t>(length(from_center) / farthest * static_cast<float>(shells)),
        shells - 1);
    std::uint32_t* shell_counts = counts.data() + shell * histograms * bins;
    const auto add = [&](std::size_t histogram, double value) {
      ++shell_counts[histogram * bins + bin_of(value, histogram)];
    };
    const std::uint8_t* rgb = cloud.colors.data() + 3 * i;
    const auto lab = detail::lab_from_rgb(rgb[0], rgb[1], rgb[2], false);
    add(3, 100 * lab[0]);
    add(4, 255 * lab[1] - 128);
    add(5, 255 * lab[2] - 128);
    const auto pair = detail::pair_features(from_center, center.normal.data(), cloud.normal(i));
    if (!pair) continue;
    add(0, pair->theta);
    add(1, pair->alpha);
    add(2, pair->phi);
  }
  return counts;
}

}  // namespace

std::vector<float> cospair(PointsView points, ColorsView colors, const CospairConfig& config,
                           int threads) {
  validate(config);
  detail::check_colors(points, colors);
  const detail::OrientedPoints cloud = detail::oriented_points(
      points, colors, config.leaf, config.normal_radius, threads, "CoSPAIR");
  detail::VfhCenter center = detail::mean_center(cloud);
  const float size = length(center.normal);
  if (!(size > 0)) throw DataError("CoSPAIR: the normals of the cloud cancel out");
  for (float& value : center.normal) value /= size;
  const Counts counts = count(cloud, center);
  std::vector<float> descriptor(counts.size());
  for (std::size_t begin = 0; begin < counts.size(); begin += bins) {
    double sum = 0;
    for (std::size_t i = begin; i < begin + bins; ++i) sum += counts[i];
    for (std::size_t i = begin; i < begin + bins && sum > 0; ++i)
      descriptor[i] = static_cast<float>(counts[i] / sum);
  }
  return descriptor;
}

}  // namespace fusionslam
