// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "common.hpp"

namespace fusionslam::bindings {
namespace {

py::typing::Dict<py::str, py::int_> counts_by_name(const OverlapCounts& counts) {
  py::typing::Dict<py::str, py::int_> named;
  named["agreeing"] = counts.agreeing;
  named["before"] = counts.before;
  named["open"] = counts.open;
  named["behind"] = counts.behind;
  named["outside"] = counts.outside;
  return named;
}

}  // namespace

void bind_registration(py::module_& module) {
  using namespace py::literals;
  module.def(
      "nearest_ranges",
      [](const PointsArg& points, double step) {
        NearestRanges nearest = without_gil([&] { return nearest_ranges(points.view(), step); });
        const int rows = nearest.rows, columns = nearest.columns;
        return to_numpy(std::move(nearest.ranges), {rows, columns});
      },
      "points"_a, py::kw_only(), "step"_a = 2.0,
      R"(Range of the nearest point in each direction, seen from the origin.

Args:
    points: float32 (N, 3), metres.
    step: width and height of a direction, degrees, 0.1 to 30.

Returns:
    float32 (rows, columns), metres: rows of elevation from -90 deg up, columns of azimuth from
    -180 deg to the left; 0 where there is no point.

Raises:
    ConfigError: another step. DataError: NaN or infinity in a point.)");
  module.def(
      "count_overlap",
      [](const PointsArg& points, const PointsArg& other, const RangesArg& other_ranges,
         const TransformArg& other_from_points, double distance,
         const std::vector<std::pair<RangesArg, TransformArg>>& further) {
        std::vector<SensorView> views{{other_ranges.ranges(), identity_transform}};
        for (const auto& [ranges, view_from_other] : further)
          views.push_back({ranges.ranges(), view_from_other.values});
        return counts_by_name(without_gil([&] {
          return count_overlap(points.view(), other.view(), views, other_from_points.values,
                               distance);
        }));
      },
      "points"_a, "other"_a, "other_ranges"_a, "other_from_points"_a, py::kw_only(),
      "distance"_a = 0.5, "further"_a = py::tuple(),
      R"(Counts the points of a cloud by what another sensor saw where they are.

Args:
    points: float32 (N, 3), metres.
    other: float32 (M, 3), points of the other cloud, its sensor at the origin.
    other_ranges: nearest_ranges of all that the other sensor saw.
    other_from_points: float64 (4, 4), rigid.
    distance: metres. Points this near agree, and points this much nearer than the nearest range
        in their direction and the eight about it are before it.
    further: of a cloud joined of several scans, what its sensor saw from other places: pairs of
        nearest_ranges and float64 (4, 4) view_from_other. A point is before a surface if any view
        saw its place to be free; else the view counts that could have seen it best.

Returns:
    Number of points by name: "agreeing" (a point of the other cloud is near); of the rest "before"
    (in space that the other sensor saw to be free), "open" (in its view, where nothing came back),
    "behind" (hidden by a surface, or at its edge), "outside" (of its view or range).

Raises:
    ConfigError: distance is not in (0, 100]. ShapeError: arrays of other shapes.
    DataError: NaN or infinity in a point; a range that is negative or not finite; a transform that
        is not rigid.)");
}

}  // namespace fusionslam::bindings
