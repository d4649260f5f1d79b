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

py::array_t<double> matrix_of(std::span<const double> values, py::ssize_t side) {
  return to_numpy(std::vector<double>(values.begin(), values.end()), {side, side});
}

constexpr char information_name[] = "information";

SurfaceCloud cloud_from_state(const py::object& state) {
  constexpr const char* name = "a cloud of surfaces";
  const PointsArg points(part_of_state<py::object>(state, 0, 2, name));
  const auto neighbors = part_of_state<int>(state, 1, 2, name);
  return without_gil([&] { return SurfaceCloud(points.view(), neighbors); });
}

Refinement refinement_from_state(const py::object& state) {
  constexpr const char* name = "a refinement";
  constexpr std::size_t parts = 6;
  return {
      TransformArg(part_of_state<py::object>(state, 0, parts, name)).values,
      MatrixArg<6, 6, information_name>(part_of_state<py::object>(state, 1, parts, name)).values,
      part_of_state<double>(state, 2, parts, name),
      part_of_state<std::size_t>(state, 3, parts, name),
      part_of_state<int>(state, 4, parts, name),
      part_of_state<bool>(state, 5, parts, name)};
}

void bind_refinement(py::module_& module) {
  using namespace py::literals;
  py::class_<SurfaceCloud>(module, "SurfaceCloud", R"(A cloud as refine_pose needs it.

Each point has the normal of the surface through its nearest points.

Args:
    points: float32 (N, 3), metres, N >= 20.
    neighbors: how many of the nearest points, itself included, give a point its normal: 3 to 64.

Raises:
    ConfigError: another number. DataError: fewer points than 20 or than neighbours; NaN, infinity
        or more than 1e15 m in a point.)")
      .def(py::init([](const PointsArg& points, int neighbors) {
             return without_gil([&] { return SurfaceCloud(points.view(), neighbors); });
           }),
           "points"_a, py::kw_only(), "neighbors"_a = 10)
      .def("__len__", &SurfaceCloud::size)
      .def(py::pickle(
          [](const SurfaceCloud& self) {
            return py::make_tuple(rows_of_three(self.points()), self.neighbors());
          },
          &cloud_from_state));
  py::class_<Refinement>(module, "Refinement", "What refine_pose found.")
      .def_property_readonly(
          "target_from_source",
          [](const Refinement& self) { return matrix_of(self.target_from_source, 4); },
          "float64 (4, 4).")
      .def_property_readonly(
          "information", [](const Refinement& self) { return matrix_of(self.information, 6); },
          "float64 (6, 6): x, y, z, then rotations about x, y, z, as small motions in the source's "
          "frame, where the variance along surfaces is 1 m^2 and across them 1e-3.")
      .def_readonly("error", &Refinement::error, "Half the sum of squared Mahalanobis distances.")
      .def_readonly("inliers", &Refinement::inliers,
                    "Number of points of the source with a neighbour within the distance.")
      .def_readonly("iterations", &Refinement::iterations, "Number of steps.")
      .def_readonly("converged", &Refinement::converged,
                    "Whether the last step was small, or none lowers the error.")
      .def(py::pickle(
          [](const Refinement& self) {
            return py::make_tuple(matrix_of(self.target_from_source, 4),
                                  matrix_of(self.information, 6), self.error, self.inliers,
                                  self.iterations, self.converged);
          },
          &refinement_from_state));
  const RefinementLimits defaults;
  module.def(
      "refine_pose",
      [](const SurfaceCloud& source, const SurfaceCloud& target, const TransformArg& start,
         double distance, int iterations, double step) {
        return without_gil([&] {
          return refine_pose(source, target, start.values, {distance, iterations, step});
        });
      },
      "source"_a, "target"_a, "start"_a, py::kw_only(), "distance"_a = defaults.distance,
      "iterations"_a = defaults.iterations, "step"_a = defaults.step,
      R"(Refine a pose by generalised ICP (Segal, Haehnel, Thrun 2009).

Equal input gives equal bits.

Args:
    source, target: clouds.
    start: float64 (4, 4), target_from_source, rigid.
    distance: metres, up to 1e15: farther neighbours do not correspond.
    iterations: most steps.
    step: it ends when a step is below so many metres and radians.

Returns:
    The pose; start itself, unconverged, if no point has a neighbour within the distance.

Raises:
    ConfigError: another distance, number of steps or step.
    DataError: start is no rigid motion or far away.)");
}

}  // namespace

void bind_registration(py::module_& module) {
  using namespace py::literals;
  bind_refinement(module);
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
