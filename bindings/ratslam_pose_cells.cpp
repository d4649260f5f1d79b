// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "common.hpp"
#include "shared_index.hpp"

namespace fusionslam::bindings {
namespace {

using SharedSheet = SharedIndex<PoseSheet>;

py::array_t<double> activity_of(const SharedSheet& self) {
  int n = 0;
  std::vector<double> cells = self.read([&](const PoseSheet& sheet) {
    n = sheet.size();
    return std::vector<double>(sheet.activity().begin(), sheet.activity().end());
  });
  return to_numpy(std::move(cells), {PoseSheet::headings, n, n});
}

std::unique_ptr<SharedSheet> sheet_from_state(const py::object& state) {
  constexpr const char* name = "a sheet of pose cells";
  PoseSheet sheet(part_of_state<int>(state, 0, 2, name));
  const NumbersArg activity(part_of_state<py::object>(state, 1, 2, name));
  sheet.assign(activity.values());
  return std::make_unique<SharedSheet>(std::move(sheet));
}

void bind_sheet(py::module_& module) {
  using namespace py::literals;
  py::class_<SharedSheet>(
      module, "PoseSheet",
      R"(The sheet of pose cells: float64 (36, n, n) by heading, y and x, wrapped on all axes.

It starts with all activity in the middle cell. Threads may share it.

Raises:
    ConfigError: a size that is not 7 to 1000.)")
      .def(py::init([](int size) { return std::make_unique<SharedSheet>(PoseSheet(size)); }),
           "size"_a)
      .def_property_readonly("activity", &activity_of,
                             "float64 (36, n, n) by heading, y and x; not negative: a copy.")
      .def(
          "assign",
          [](SharedSheet& self, const NumbersArg& activity) {
            self.write([&](PoseSheet& sheet) { sheet.assign(activity.values()); });
          },
          "activity"_a,
          R"(Takes over stored activity, of any shape with as many cells.

Raises:
    ShapeError: another number of cells. DataError: a cell that is negative or not finite, or a sum
    that is 0 or not finite. The sheet is then as before.)")
      .def(
          "settle",
          [](SharedSheet& self, double global_inhibition) {
            self.write_long([&](PoseSheet& sheet) { sheet.settle(global_inhibition); });
          },
          "global_inhibition"_a,
          R"(One step of the attractor: excitation, inhibition, and the sum 1.

Raises:
    ConfigError: no activity is left; the sheet is then as before.)")
      .def(
          "move",
          [](SharedSheet& self, const NumbersArg& x, const NumbersArg& y, double layers) {
            self.write_long([&](PoseSheet& sheet) { sheet.move(x.values(), y.values(), layers); });
          },
          "x"_a, "y"_a, "layers"_a,
          R"(Moves activity, exactly over whole cells and linearly between them.

Args:
    x, y: float64 (36,), cells that each layer moves by, finite and of any length.
    layers: that everything then moves by along the headings.

Raises:
    ShapeError: not 36 ways. DataError: one that is not finite.)")
      .def(
          "inject",
          [](SharedSheet& self, double x, double y, double th, double energy) {
            self.write([&](PoseSheet& sheet) { sheet.inject({x, y, th}, energy); });
          },
          "x"_a, "y"_a, "th"_a, "energy"_a,
          R"(Adds energy at a place in cells: to the eight cells round it, whose mean it is.

Raises:
    DataError: a number that is not finite, or negative energy.)")
      .def(
          "decode",
          [](const SharedSheet& self) {
            const SheetPlace place =
                self.read([](const PoseSheet& sheet) { return sheet.decode(); });
            return std::make_tuple(place.x, place.y, place.th);
          },
          R"(Where the packet is: x, y and th in cells.

The circular means over the box of seven cells a side around the largest cell, the first one of
equally large ones.)")
      .def(py::pickle(
          [](const SharedSheet& self) {
            const int size = self.read([](const PoseSheet& sheet) { return sheet.size(); });
            return py::make_tuple(size, activity_of(self));
          },
          &sheet_from_state));
}

}  // namespace

void bind_ratslam_pose_cells(py::module_& module) { bind_sheet(module); }

}  // namespace fusionslam::bindings
