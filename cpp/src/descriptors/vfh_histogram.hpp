// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "oriented_points.hpp"

namespace fusionslam::detail {

using Vector3 = std::array<float, 3>;

inline float dot(const float* a, const float* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/// Angles between two oriented points in the frame u, v, w of the first: u is its normal, v is at
/// right angles to u and to the line between the points (Wahl, Hillenbrand, Hirzinger 2003).
struct PairFeatures {
  float theta;     ///< of the second normal about v, from u: -pi to pi
  float alpha;     ///< its cosine to v
  float phi;       ///< cosine between u and the line
  float distance;  ///< metres
};

/// Features of the pair whose second point is `offset` from the first; none if the points coincide
/// or the first normal lies along the line.
std::optional<PairFeatures> pair_features(const Vector3& offset, const float* first_normal,
                                          const float* second_normal);

/// The same, the first point being the one whose normal makes the smaller angle with the line, as
/// PCL's computePairFeatures.
std::optional<PairFeatures> ordered_pair_features(const Vector3& offset, const float* first_normal,
                                                  const float* second_normal);

/// Where the pairs of a VFH begin.
struct VfhCenter {
  Vector3 point;
  Vector3 normal;
};

/// Mean point and mean normal, which is shorter than 1, of a cloud that is not empty.
VfhCenter mean_center(const OrientedPoints& cloud);

inline constexpr std::size_t vfh_angle_bins = 45;
inline constexpr std::size_t vfh_view_bins = 128;
inline constexpr std::size_t vfh_view_begin = 4 * vfh_angle_bins;
inline constexpr std::size_t vfh_size = vfh_view_begin + vfh_view_bins;

/// The VFH of all points about a centre, as PCL bins it: theta, alpha, phi, distance over that of
/// the farthest point, and angle to the direction from the centre to the origin. These are PCL's
/// values for a given centre; where it computes the centroid itself, the fourth coordinate of that,
/// 1, gets into the distance of the farthest point and into the direction.
std::array<float, vfh_size> vfh_histogram(const OrientedPoints& cloud, const VfhCenter& center);

}  // namespace fusionslam::detail
