// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Compares clouds that were registered by what each sensor should have seen of the other cloud.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "fusionslam/sensors.hpp"

namespace fusionslam {

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
