// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Offsets, distances and dot products are floats, summed in PCL's order, so that each point falls
// into the bin PCL gives it; interpolation alone is in double.
#include "shot_kernel.hpp"

#include <cmath>

#include "../detail/simd.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t chunk = 256;

FUSIONSLAM_INLINE double smaller(double a, double b) { return a < b ? a : b; }
FUSIONSLAM_INLINE double larger(double a, double b) { return a > b ? a : b; }
FUSIONSLAM_INLINE double magnitude(double a) { return a < 0 ? -a : a; }

/// Offsets from the keypoint and their squared length; the length is `outside` for points that do
/// not count.
struct Offsets {
  float x[chunk], y[chunk], z[chunk], squared[chunk];
};

FUSIONSLAM_INLINE void find_offsets(const ShotSupport& support, std::size_t begin, std::size_t size,
                                    Offsets& offsets) {
  const float cx = support.center[0], cy = support.center[1], cz = support.center[2];
  for (std::size_t i = 0; i < size; ++i) {
    const float x = support.x[begin + i] - cx;
    const float y = support.y[begin + i] - cy;
    const float z = support.z[begin + i] - cz;
    offsets.x[i] = x;
    offsets.y[i] = y;
    offsets.z[i] = z;
    offsets.squared[i] = x * x + y * y + z * z;
  }
}

FUSIONSLAM_INLINE int counts(const Offsets& offsets, std::size_t i, float squared_radius) {
  const int elsewhere = (offsets.x[i] != 0) | (offsets.y[i] != 0) | (offsets.z[i] != 0);
  return (offsets.squared[i] < squared_radius) & elsewhere;
}

FUSIONSLAM_INLINE void scatter_chunk(const Offsets& offsets, std::size_t size,
                                     const ShotSupport& support, ShotScatter& scatter) {
  double weights[chunk];
  int counted[chunk];
  for (std::size_t i = 0; i < size; ++i) {
    const double weight = support.radius - std::sqrt(static_cast<double>(offsets.squared[i]));
    counted[i] = counts(offsets, i, support.squared_radius);
    weights[i] = counted[i] ? weight : 0;
  }
  double products[6][chunk];
  for (std::size_t i = 0; i < size; ++i) {
    const double x = offsets.x[i], y = offsets.y[i], z = offsets.z[i], weight = weights[i];
    products[0][i] = weight * (x * x);
    products[1][i] = weight * (x * y);
    products[2][i] = weight * (x * z);
    products[3][i] = weight * (y * y);
    products[4][i] = weight * (y * z);
    products[5][i] = weight * (z * z);
  }
  for (std::size_t i = 0; i < size; ++i) {
    for (std::size_t k = 0; k < 6; ++k) scatter.sums[k] += products[k][i];
    scatter.weight += weights[i];
    scatter.count += static_cast<std::size_t>(counted[i]);
  }
}

FUSIONSLAM_INLINE ShotScatter sum_scatter(const ShotSupport& support, std::size_t begin,
                                          std::size_t end) {
  ShotScatter scatter{};
  Offsets offsets;
  for (; begin < end; begin += chunk) {
    const std::size_t size = end - begin < chunk ? end - begin : chunk;
    find_offsets(support, begin, size, offsets);
    scatter_chunk(offsets, size, support, scatter);
  }
  return scatter;
}

FUSIONSLAM_INLINE ShotSides count_sides(const ShotSupport& support, std::size_t begin,
                                        std::size_t end, const double* first,
                                        const double* second) {
  const double a[3] = {first[0], first[1], first[2]}, b[3] = {second[0], second[1], second[2]};
  ShotSides sides{0, 0};
  Offsets offsets;
  for (; begin < end; begin += chunk) {
    const std::size_t size = end - begin < chunk ? end - begin : chunk;
    find_offsets(support, begin, size, offsets);
    int before_first = 0, before_second = 0;
    for (std::size_t i = 0; i < size; ++i) {
      const double x = offsets.x[i], y = offsets.y[i], z = offsets.z[i];
      const int counted = counts(offsets, i, support.squared_radius);
      before_first += (x * a[0] + y * a[1] + z * a[2] >= 0) & counted;
      before_second += (x * b[0] + y * b[1] + z * b[2] >= 0) & counted;
    }
    sides.first += static_cast<std::size_t>(before_first);
    sides.second += static_cast<std::size_t>(before_second);
  }
  return sides;
}

/// Coordinates in the frame, and everything that follows from them, a chunk at a time. A point
/// votes in its volume and, by how far it is from the volume's middle, in its neighbour in radius,
/// elevation and azimuth.
struct Votes {
  double x[chunk], y[chunk], z[chunk], distance[chunk], cosine[chunk];
  double volume[chunk], next_azimuth[chunk];
  double own[chunk];  ///< what remains for the own volume of the votes in the three directions
  double radial[chunk], elevation[chunk], azimuth[chunk];
  double counted[chunk];  ///< 1, or 0 for a point that has no vote
};

/// Eigen's sum of four products, the last of them 0.
FUSIONSLAM_INLINE float dot(float ax, float ay, float az, const float* b) {
  return (ax * b[0] + az * b[2]) + ay * b[1];
}

FUSIONSLAM_INLINE double without_noise(double value) {
  return magnitude(value) < 1e-30 ? 0 : value;
}

FUSIONSLAM_INLINE void find_coordinates(const ShotSupport& support, std::size_t begin,
                                        std::size_t size, const ShotFrame& frame,
                                        const Offsets& offsets, Votes& votes) {
  const float squared_radius = support.squared_radius;
  for (std::size_t i = 0; i < size; ++i) {
    const float x = offsets.x[i], y = offsets.y[i], z = offsets.z[i];
    votes.x[i] = without_noise(dot(x, y, z, frame.x));
    votes.y[i] = without_noise(dot(x, y, z, frame.y));
    votes.z[i] = without_noise(dot(x, y, z, frame.z));
    const double distance = std::sqrt(static_cast<double>(offsets.squared[i]));
    const double counted = offsets.squared[i] < squared_radius ? 1 : 0;
    votes.counted[i] = distance < 1e-15 ? 0 : counted;
    votes.distance[i] = larger(distance, 1e-15);
    const double cosine = dot(support.normal_x[begin + i], support.normal_y[begin + i],
                              support.normal_z[begin + i], frame.z);
    votes.cosine[i] = larger(smaller(cosine, 1), -1);
  }
}

/// The volume's number: azimuth x 4 + outer x 2 + upper. Azimuths count the eighths of a turn
/// from -180 degrees; a point on an edge belongs to the one PCL's comparisons give it.
FUSIONSLAM_INLINE void find_volumes(std::size_t size, double half_radius, Votes& votes) {
  for (std::size_t i = 0; i < size; ++i) {
    const double x = votes.x[i], y = votes.y[i];
    const int left = (y > 0) | ((y == 0) & (x < 0));
    const int ahead = (x > 0) | ((x == 0) & (y > 0));
    const int quarter = 2 * left + (ahead ^ left);
    const int aligned = (x * y > 0) | (x == 0);
    const double ax = magnitude(x), ay = magnitude(y);
    const int steep = aligned ? ax < ay : ax > ay;
    const int azimuth = 2 * quarter + steep;
    const int outer = votes.distance[i] > half_radius, upper = votes.z[i] > 0;
    votes.volume[i] = 4 * azimuth + 2 * outer + upper;
  }
}

/// atan(t) in eighths of a turn for 0 <= t <= 1, within 3e-9: a least-squares fit at Chebyshev
/// nodes.
FUSIONSLAM_INLINE double eighths(double t) {
  const double u = t * t;
  double sum = -0.0022201492514991993;
  sum = sum * u + 0.013599114368137998;
  sum = sum * u - 0.03911074705588939;
  sum = sum * u + 0.07316487423406028;
  sum = sum * u - 0.106596428895428;
  sum = sum * u + 0.13929493949580718;
  sum = sum * u - 0.18158399579866985;
  sum = sum * u + 0.25462538076059044;
  sum = sum * u - 0.4244125317446608;
  sum = sum * u + 1.2732395416106574;
  return sum * t;
}

/// Angle from the axis of the larger of two numbers that are not negative, in eighths of a turn.
FUSIONSLAM_INLINE double eighths(double a, double b) {
  return eighths(smaller(a, b) / larger(larger(a, b), 1e-300));
}

FUSIONSLAM_INLINE void find_weights(std::size_t size, double radius, Votes& votes) {
  const double quarter_radius = radius / 4, half_radius = radius / 2,
               three_quarters = radius * 3 / 4;
  for (std::size_t i = 0; i < size; ++i) {
    const double distance = votes.distance[i], counted = votes.counted[i];
    const bool outer = distance > half_radius;
    const double from_middle = (distance - (outer ? three_quarters : quarter_radius)) / half_radius;
    const double inwards = outer ? -from_middle : from_middle;  // towards the other shell
    votes.radial[i] = counted * larger(inwards, 0);

    const double cosine = smaller(magnitude(votes.z[i]) / distance, 1);
    const double sine = std::sqrt(1 - cosine * cosine);
    const double angle = eighths(sine, cosine) / 2;
    const double from_pole = (sine <= cosine ? angle : 1 - angle) - 0.5;  // in quarters of a turn
    votes.elevation[i] = counted * larger(from_pole, 0);

    const double ax = magnitude(votes.x[i]), ay = magnitude(votes.y[i]);
    const double has_azimuth = larger(ax, ay) > 0 ? counted : 0;
    const int azimuth = static_cast<int>(votes.volume[i]) >> 2;
    const double from_edge = eighths(ax, ay) - 0.5;
    const double turn = azimuth & 1 ? -from_edge : from_edge;
    votes.azimuth[i] = has_azimuth * magnitude(turn);
    votes.next_azimuth[i] = turn > 0 ? 4 : -4;

    votes.own[i] = counted * (2 - magnitude(from_middle) - magnitude(from_pole)) + has_azimuth -
                   votes.azimuth[i];
  }
}

/// The two bins in the histogram of its volume that a point votes for.
struct Bins {
  int own[chunk], next[chunk];
  double share[chunk];  ///< of the next bin; the rest of the vote is the own bin's
};

/// The bins are centred on whole numbers. PCL wraps around at `bins`, though there is a slot more.
FUSIONSLAM_INLINE void find_bins(const double* positions, std::size_t size, int bins,
                                 Bins& result) {
  for (std::size_t i = 0; i < size; ++i) {
    const int own = static_cast<int>(positions[i] + 0.5);
    const double share = positions[i] - own;
    const int next = share > 0 ? own + 1 : own - 1;
    result.own[i] = own;
    result.next[i] = next < 0 ? bins - 1 : next >= bins ? next - bins : next;
    result.share[i] = magnitude(share);
  }
}

FUSIONSLAM_INLINE void add(const Votes& votes, const Bins& bins, std::size_t size, int slots,
                           double* histogram) {
  for (std::size_t i = 0; i < size; ++i) {
    const int volume = static_cast<int>(votes.volume[i]);
    const int next = (volume + static_cast<int>(votes.next_azimuth[i])) & (shot_volumes - 1);
    const double share = votes.counted[i] * bins.share[i];
    double* own = histogram + volume * slots;
    own[bins.own[i]] += votes.own[i] + (votes.counted[i] - share);
    own[bins.next[i]] += share;
    histogram[(volume ^ 2) * slots + bins.own[i]] += votes.radial[i];
    histogram[(volume ^ 1) * slots + bins.own[i]] += votes.elevation[i];
    histogram[next * slots + bins.own[i]] += votes.azimuth[i];
  }
}

FUSIONSLAM_INLINE void add_votes(const ShotSupport& support, std::size_t begin, std::size_t end,
                                 const ShotFrame& frame, double* histogram) {
  Offsets offsets;
  Votes votes;
  Bins bins;
  double positions[chunk];
  for (; begin < end; begin += chunk) {
    const std::size_t size = end - begin < chunk ? end - begin : chunk;
    find_offsets(support, begin, size, offsets);
    find_coordinates(support, begin, size, frame, offsets, votes);
    find_volumes(size, support.radius / 2, votes);
    find_weights(size, support.radius, votes);
    constexpr int shape_bins = shot_shape_slots - 1, color_bins = shot_color_slots - 1;
    for (std::size_t i = 0; i < size; ++i) positions[i] = (1 + votes.cosine[i]) * shape_bins / 2;
    find_bins(positions, size, shape_bins, bins);
    add(votes, bins, size, shot_shape_slots, histogram);
    if (support.color == nullptr) continue;
    for (std::size_t i = 0; i < size; ++i)
      positions[i] =
          larger(smaller(static_cast<double>(support.color[begin + i]), 1), 0) * color_bins;
    find_bins(positions, size, color_bins, bins);
    add(votes, bins, size, shot_color_slots, histogram + shot_shape_size);
  }
}

}  // namespace

ShotKernels shot_kernels(SimdLevel level) {
  return {compiled_for<sum_scatter>(level), compiled_for<count_sides>(level),
          compiled_for<add_votes>(level)};
}

}  // namespace fusionslam::detail
