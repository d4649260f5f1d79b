// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Registers clouds, and compares them by what each sensor should have seen of the other cloud.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "fusionslam/sensors.hpp"

namespace fusionslam {

namespace detail {
struct SurfaceBlocks;
}

/// Fewer points have no surface to register.
inline constexpr std::size_t fewest_surface_points = 20;

/// A cloud as refine_pose() needs it: points in blocks of neighbours, each with the normal of the
/// surface through its nearest points. 46 bytes a point. Copies share it; threads may, too.
class SurfaceCloud {
 public:
  /// `neighbors`: how many of the nearest points, itself included, give a point its normal: 3 to
  /// 64. Points as far as the last of them count, too.
  /// Throws ConfigError for other numbers; DataError for fewer points than `fewest_surface_points`
  /// or `neighbors`, for points that are not finite or more than 1e15 m from the origin.
  explicit SurfaceCloud(PointsView points, int neighbors = 10);

  std::size_t size() const;
  int neighbors() const;
  std::vector<float> points() const;  ///< x, y, z of each, in the order they were given
  const detail::SurfaceBlocks& blocks() const { return *blocks_; }

 private:
  std::shared_ptr<const detail::SurfaceBlocks> blocks_;
};

/// What refine_pose() found.
struct Refinement {
  Transform target_from_source;
  /// Row-major 6 x 6 matrix of information: x, y, z, then rotations about x, y, z, as small motions
  /// in the source's frame, where the variance along surfaces is 1 m^2 and across them 1e-3.
  std::array<double, 36> information;
  double error = 0;         ///< half the sum of squared Mahalanobis distances
  std::size_t inliers = 0;  ///< points of the source with a neighbour within the distance
  int iterations = 0;
  bool converged = false;  ///< whether the last step was small, or none lowers the error
};

/// Options of refine_pose().
struct RefinementLimits {
  double distance = 1;  ///< metres, up to 1e15: farther neighbours do not correspond
  int iterations = 30;  ///< at most, 1 or more
  double step = 1e-4;   ///< it ends when a step is below so many metres and radians
};

/// Refines a pose by generalised ICP (Segal, Haehnel, Thrun 2009) with Levenberg's and Marquardt's
/// steps. The nearest neighbours are exact. The same bits for any SIMD level.
///
/// Without any neighbour within the distance it returns `start`, unconverged, without information.
/// Throws ConfigError for other limits, DataError if `start` is no rigid motion.
Refinement refine_pose(const SurfaceCloud& source, const SurfaceCloud& target,
                       const Transform& start, const RefinementLimits& limits = {});

/// Range of the nearest point in each direction, seen from the origin.
struct NearestRanges {
  int rows = 0;               ///< of elevation, from -90 deg up
  int columns = 0;            ///< of azimuth, from -180 deg to the left
  std::vector<float> ranges;  ///< row-major, metres; 0 where there is no point
};

/// The nearest ranges in cells of about `step` degrees (0.1 to 30). Points at the origin have no
/// direction and are left out. Throws ConfigError for other steps, DataError for points that are
/// not finite.
NearestRanges nearest_ranges(PointsView points, double step);

/// What another sensor saw where the points of a cloud are. Every point is counted once.
struct OverlapCounts {
  std::size_t agreeing = 0;  ///< a point of the other cloud is near
  std::size_t before = 0;    ///< in space that the other sensor saw to be free
  std::size_t open = 0;      ///< in view, in a direction from which nothing came back
  std::size_t behind = 0;    ///< hidden by a surface, or at its edge
  std::size_t outside = 0;   ///< out of the other sensor's view or range
};

/// Counts the points of a cloud by what the other sensor saw.
///
/// `other` are points of the other cloud, `seen` the nearest ranges of all that its sensor saw.
/// A point is before a surface if it is more than `distance` nearer than the nearest of its own and
/// the eight neighbouring directions. Throws ConfigError unless `distance` is positive and at
/// most 100 m, ShapeError if `seen` is no complete grid, DataError for points that are
/// not finite, ranges that are negative or not finite, and transforms that are not rigid.
OverlapCounts count_overlap(PointsView points, PointsView other, const NearestRanges& seen,
                            const Transform& other_from_points, double distance);

/// What a sensor saw from one of the places that a cloud was joined of.
struct SensorView {
  NearestRanges seen;
  Transform view_from_cloud = identity_transform;
};

/// The same for a cloud that was joined of several views. A point is before a surface if it is in
/// the free space of any view; else it is hidden, open or outside by the view that could have seen
/// it best, in this order. Throws ShapeError without views, too.
OverlapCounts count_overlap(PointsView points, PointsView other, std::span<const SensorView> views,
                            const Transform& other_from_points, double distance);

}  // namespace fusionslam
