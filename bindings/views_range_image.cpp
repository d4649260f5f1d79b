// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Range images for Python and for JSON.
#include <tuple>
#include <utility>

#include "common.hpp"

namespace fusionslam::bindings {
namespace {

using ReducedImage =
    py::typing::Tuple<py::type, py::typing::Tuple<py::array, float, float, py::object>>;

RangeImage check_image(RangeImage&& image) {
  if (image.cells.empty()) return {};
  check_range_image(image);
  return std::move(image);
}

}  // namespace

py::dict image_to_dict(const RangeImage& image) {
  using namespace py::literals;
  py::list cells;
  for (const RangeImage::Cell& cell : image.cells)
    cells.append(py::make_tuple(cell.column, cell.row, cell.range, cell.color[0], cell.color[1],
                                cell.color[2]));
  return py::dict("azimuth_step"_a = image.azimuth_step, "elevation_step"_a = image.elevation_step,
                  "sensor"_a = image.sensor, "cells"_a = cells);
}

RangeImage image_from_dict(const py::dict& entry) {
  RangeImage image;
  try {
    image.azimuth_step = entry["azimuth_step"].cast<float>();
    image.elevation_step = entry["elevation_step"].cast<float>();
    image.sensor = entry["sensor"].cast<std::array<float, 3>>();
    using Row = std::tuple<std::int16_t, std::int16_t, std::uint16_t, std::uint8_t, std::uint8_t,
                           std::uint8_t>;
    for (const py::handle row : entry["cells"]) {
      const auto [column, height, range, red, green, blue] = row.cast<Row>();
      image.cells.push_back({column, height, range, {red, green, blue}});
    }
  } catch (const py::cast_error&) {
    throw DataError("JSON of a scene: its image is none");
  } catch (py::error_already_set& error) {
    if (!error.matches(PyExc_KeyError) && !error.matches(PyExc_TypeError)) throw;
    throw DataError("JSON of a scene: its image is none");
  }
  return check_image(std::move(image));
}

void bind_views_range_image(py::module_& module) {
  using namespace py::literals;
  using Cell = RangeImage::Cell;
  PYBIND11_NUMPY_DTYPE(Cell, column, row, range, color);
  py::class_<RangeImage>(module, "RangeImage",
                         R"(Range and colour of the nearest surface in each direction of a cloud.

Immutable; equal if all cells are.)")
      .def(py::init([](const py::array& cells, float azimuth_step, float elevation_step,
                       const std::array<float, 3>& sensor) {
             if (cells.ndim() != 1 || !cells.dtype().equal(py::dtype::of<Cell>()))
               throw ShapeError(
                   "cells is no array like RangeImage.cells: one dimension, fields "
                   "column, row, range, color");
             const auto array = contiguous<Cell>(cells);
             return check_image({azimuth_step,
                                 elevation_step,
                                 sensor,
                                 {array.data(), array.data() + array.size()}});
           }),
           "cells"_a, "azimuth_step"_a, "elevation_step"_a, "sensor"_a)
      .def_property_readonly(
          "cells",
          [](const py::object& self) -> py::array {
            const auto& cells = self.cast<const RangeImage&>().cells;
            py::array_t<Cell> array({static_cast<py::ssize_t>(cells.size())}, cells.data(), self);
            array.attr("flags").attr("writeable") = false;
            return array;
          },
          R"(Read-only structured array; fields column and row (steps of azimuth to the left and of
elevation up, from straight ahead), range (cm), color (3) RGB.)")
      .def_readonly("azimuth_step", &RangeImage::azimuth_step, "Degrees.")
      .def_readonly("elevation_step", &RangeImage::elevation_step, "Degrees.")
      .def_readonly("sensor", &RangeImage::sensor,
                    "Origin of the directions in the frame of the cloud, metres.")
      .def("__len__", [](const RangeImage& self) { return self.cells.size(); })
      .def("__eq__",
           [](const RangeImage& self, const py::object& other) {
             return py::isinstance<RangeImage>(other) && self == other.cast<const RangeImage&>();
           })
      .def("__hash__", [](const RangeImage& self) { return self.cells.size(); })
      .def("__reduce__", [](const py::object& self) -> ReducedImage {
        const py::tuple parts = py::make_tuple(
            py::object(self.attr("cells")), py::object(self.attr("azimuth_step")),
            py::object(self.attr("elevation_step")), py::object(self.attr("sensor")));
        return py::make_tuple(py::type::of(self), parts);
      });
}

}  // namespace fusionslam::bindings
