// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "vfh_histogram.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace fusionslam::detail {
namespace {

using Counts = std::array<std::uint32_t, vfh_size>;

float length(const Vector3& v) { return std::sqrt(dot(v.data(), v.data())); }

Vector3 cross(const float* a, const float* b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

Vector3 offset_from(const Vector3& center, const float* point) {
  return {point[0] - center[0], point[1] - center[1], point[2] - center[2]};
}

float farthest_distance(const OrientedPoints& cloud, const Vector3& center) {
  float farthest = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i)
    farthest = std::max(farthest, length(offset_from(center, cloud.point(i))));
  return farthest;
}

std::size_t bin_of(double share, std::size_t bins) {
  const double bin = std::floor(share * static_cast<double>(bins));
  return static_cast<std::size_t>(std::clamp(bin, 0.0, static_cast<double>(bins - 1)));
}

/// Cosines, too, are binned as if they were angles.
std::size_t angle_bin(float value) {
  return bin_of((static_cast<double>(value) + std::numbers::pi) / (2 * std::numbers::pi),
                vfh_angle_bins);
}

Counts count_pairs(const OrientedPoints& cloud, const VfhCenter& center) {
  Counts counts{};
  const float farthest = farthest_distance(cloud, center.point);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto pair = ordered_pair_features(offset_from(center.point, cloud.point(i)),
                                            center.normal.data(), cloud.normal(i));
    if (!pair) continue;
    ++counts[angle_bin(pair->theta)];
    ++counts[vfh_angle_bins + angle_bin(pair->alpha)];
    ++counts[2 * vfh_angle_bins + angle_bin(pair->phi)];
    ++counts[3 * vfh_angle_bins +
             bin_of(static_cast<double>(pair->distance) / static_cast<double>(farthest),
                    vfh_angle_bins)];
  }
  return counts;
}

void count_views(const OrientedPoints& cloud, const Vector3& center, Counts& counts) {
  const float distance = length(center);
  Vector3 to_origin{};
  if (distance > 0)
    to_origin = {-center[0] / distance, -center[1] / distance, -center[2] / distance};
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double cosine = dot(cloud.normal(i), to_origin.data());
    ++counts[vfh_view_begin + bin_of(0.5 * (cosine + 1), vfh_view_bins)];
  }
}

}  // namespace

std::optional<PairFeatures> pair_features(const Vector3& offset, const float* first_normal,
                                          const float* second_normal) {
  const float distance = length(offset);
  Vector3 v = cross(offset.data(), first_normal);
  const float v_length = length(v);
  if (!(distance > 0) || !(v_length > 0)) return std::nullopt;
  for (float& value : v) value /= v_length;
  const Vector3 w = cross(first_normal, v.data());
  return PairFeatures{std::atan2(dot(w.data(), second_normal), dot(first_normal, second_normal)),
                      dot(v.data(), second_normal), dot(first_normal, offset.data()) / distance,
                      distance};
}

std::optional<PairFeatures> ordered_pair_features(const Vector3& offset, const float* first_normal,
                                                  const float* second_normal) {
  const float first = std::abs(dot(first_normal, offset.data()));
  const float second = std::abs(dot(second_normal, offset.data()));
  if (!(first < second)) return pair_features(offset, first_normal, second_normal);
  return pair_features({-offset[0], -offset[1], -offset[2]}, second_normal, first_normal);
}

VfhCenter mean_center(const OrientedPoints& cloud) {
  std::array<double, 3> point{}, normal{};
  for (std::size_t i = 0; i < cloud.size(); ++i)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      point[axis] += cloud.point(i)[axis];
      normal[axis] += cloud.normal(i)[axis];
    }
  const auto count = static_cast<double>(cloud.size());
  VfhCenter center;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    center.point[axis] = static_cast<float>(point[axis] / count);
    center.normal[axis] = static_cast<float>(normal[axis] / count);
  }
  return center;
}

std::array<float, vfh_size> vfh_histogram(const OrientedPoints& cloud, const VfhCenter& center) {
  Counts counts = count_pairs(cloud, center);
  count_views(cloud, center.point, counts);
  const auto size = static_cast<double>(cloud.size());
  std::array<float, vfh_size> histogram;
  for (std::size_t bin = 0; bin < vfh_size; ++bin)
    // PCL divides pairs by one less: the centre used to be one of the points.
    histogram[bin] =
        static_cast<float>(100 * counts[bin] / (bin < vfh_view_begin ? size - 1 : size));
  return histogram;
}

}  // namespace fusionslam::detail
