// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The one file that owns the rules for numpy arrays and errors.
//
// Arguments: C-contiguous, aligned arrays of the right type are viewed, everything else is copied
// once; the wrong shape or kind raises ShapeError. Results: vectors are handed to numpy without a
// copy.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <pybind11/typing.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#ifdef __GLIBCXX__
#include <cxxabi.h>
#endif

#include "fusionslam/fusionslam.hpp"

namespace fusionslam::bindings {

namespace py = pybind11;

using CloudTuple =
    py::typing::Tuple<py::array_t<float>, py::array_t<std::uint8_t>, py::array_t<std::int64_t>>;

/// Makes a call that may wait for the GIL. Once the interpreter has ended, Python (up to 3.13) ends
/// daemon threads that wait for it by unwinding their stacks, which would let go of Python objects
/// without the GIL and end the process at the first noexcept or catch (...). Such a thread sleeps
/// instead until the process has ended.
template <class Call>
auto asleep_at_exit(Call&& call) {
#ifdef __GLIBCXX__
  try {
    return call();
  } catch (const abi::__forced_unwind&) {
    for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
  }
#else
  return call();
#endif
}

/// While it lives, its thread is without the GIL.
class GilRelease {
 public:
  GilRelease() : state_(PyEval_SaveThread()) {}
  ~GilRelease() { take_back(); }
  GilRelease(const GilRelease&) = delete;
  GilRelease& operator=(const GilRelease&) = delete;

  /// Runs the handlers of signals, with the GIL; whether one of them raised.
  bool has_signal_raised() {
    take_back();
    const bool raised = PyErr_CheckSignals() != 0;
    state_ = PyEval_SaveThread();
    return raised;
  }

 private:
  void take_back() {
    asleep_at_exit([this] { PyEval_RestoreThread(state_); });
  }
  PyThreadState* state_;
};

inline std::string shape_text(const py::array& array) {
  return py::str(array.attr("shape")).cast<std::string>();
}

/// float64 is accepted for float32 and converted; integers, booleans and objects are not.
inline bool is_float(const py::array& array) { return array.dtype().kind() == 'f'; }

/// Throws ShapeError for what is no array. A lack of memory and signals are no fault of `source`.
inline py::array as_array(py::handle source, const char* name) {
  try {
    return py::array(py::reinterpret_borrow<py::object>(source));
  } catch (const py::error_already_set& error) {
    if (error.matches(PyExc_MemoryError) || !error.matches(PyExc_Exception)) throw;
    throw ShapeError(std::string(name) + " is no array");
  }
}

template <class T>
using ContiguousArray = py::array_t<T, py::array::c_style | py::array::forcecast |
                                           py::detail::npy_api::NPY_ARRAY_ALIGNED_>;

/// Throws MemoryError if there is no memory for a copy: array_t::ensure would return a null array.
template <class T>
ContiguousArray<T> contiguous(const py::array& array) {
  return ContiguousArray<T>(array);
}

/// float (N, 3).
struct PointsArg {
  ContiguousArray<float> array;

  explicit PointsArg(py::handle source) {
    const py::array given = as_array(source, "points");
    if (given.ndim() != 2 || given.shape(1) != 3)
      throw ShapeError("points has shape " + shape_text(given) + ", expected (N, 3)");
    if (!is_float(given))
      throw ShapeError("points has dtype " + py::str(given.dtype()).cast<std::string>() +
                       ", expected float32");
    array = contiguous<float>(given);
  }
  PointsView view() const { return {array.data(), static_cast<std::size_t>(array.shape(0))}; }
};

inline ContiguousArray<std::uint8_t> bytes_array(const py::array& given, const char* name) {
  if (!given.dtype().is(py::dtype::of<std::uint8_t>()) &&
      !given.dtype().equal(py::dtype::of<std::uint8_t>()))
    throw ShapeError(std::string(name) + " has dtype " +
                     py::str(given.dtype()).cast<std::string>() + ", expected uint8");
  return contiguous<std::uint8_t>(given);
}

/// uint8 (N, 3), RGB.
struct ColorsArg {
  ContiguousArray<std::uint8_t> array;

  explicit ColorsArg(py::handle source) {
    const py::array given = as_array(source, "colors");
    if (given.ndim() != 2 || given.shape(1) != 3)
      throw ShapeError("colors has shape " + shape_text(given) + ", expected (N, 3)");
    array = bytes_array(given, "colors");
  }
  ColorsView view() const { return {array.data(), static_cast<std::size_t>(array.shape(0))}; }
};

/// float (N,).
struct IntensitiesArg {
  ContiguousArray<float> array;

  explicit IntensitiesArg(py::handle source) {
    const py::array given = as_array(source, "intensities");
    if (given.ndim() != 1)
      throw ShapeError("intensities has shape " + shape_text(given) + ", expected (N,)");
    if (!is_float(given))
      throw ShapeError("intensities has dtype " + py::str(given.dtype()).cast<std::string>() +
                       ", expected float32");
    array = contiguous<float>(given);
  }
  std::span<const float> values() const {
    return {array.data(), static_cast<std::size_t>(array.size())};
  }
};

/// uint8 (H, W, 3) RGB or (H, W).
struct ImageArg {
  ContiguousArray<std::uint8_t> array;

  explicit ImageArg(py::handle source) {
    const py::array given = as_array(source, "image");
    if (given.ndim() != 2 && !(given.ndim() == 3 && given.shape(2) == 3))
      throw ShapeError("image has shape " + shape_text(given) + ", expected (H, W, 3) or (H, W)");
    constexpr py::ssize_t most = std::numeric_limits<int>::max();
    if (given.shape(0) > most || given.shape(1) > most)
      throw ShapeError("image has shape " + shape_text(given) + ", expected up to " +
                       std::to_string(most) + " pixels a side");
    array = bytes_array(given, "image");
  }
  ImageView view() const {
    const int channels = array.ndim() == 3 ? 3 : 1;
    const auto width = static_cast<int>(array.shape(1));
    return {array.data(), width, static_cast<int>(array.shape(0)), channels,
            static_cast<std::size_t>(width) * static_cast<std::size_t>(channels)};
  }
};

/// A number of any kind is taken for a float64.
inline py::array as_numbers(py::handle source, const char* name) {
  py::array given = as_array(source, name);
  const char kind = given.dtype().kind();
  if (kind != 'f' && kind != 'i' && kind != 'u')
    throw ShapeError(std::string(name) + " has dtype " +
                     py::str(given.dtype()).cast<std::string>() + ", expected float64");
  return given;
}

/// float64 (Rows, Columns).
template <int Rows, int Columns, const char* Name>
struct MatrixArg {
  std::array<double, Rows * Columns> values;

  explicit MatrixArg(py::handle source) {
    const py::array given = as_numbers(source, Name);
    if (given.ndim() != 2 || given.shape(0) != Rows || given.shape(1) != Columns)
      throw ShapeError(std::string(Name) + " has shape " + shape_text(given) + ", expected (" +
                       std::to_string(Rows) + ", " + std::to_string(Columns) + ")");
    const auto array = contiguous<double>(given);
    std::copy_n(array.data(), Rows * Columns, values.begin());
  }
};

/// float64 (K,), of any length.
struct DistortionArg {
  std::vector<double> values;

  explicit DistortionArg(py::handle source) {
    const py::array given = as_numbers(source, "distortion");
    if (given.ndim() != 1)
      throw ShapeError("distortion has shape " + shape_text(given) + ", expected (K,)");
    const auto array = contiguous<double>(given);
    values.assign(array.data(), array.data() + array.size());
  }
};

/// float (H, W), pixels.
struct DisparityArg {
  ContiguousArray<float> array;

  explicit DisparityArg(py::handle source) {
    const py::array given = as_array(source, "disparity");
    if (given.ndim() != 2)
      throw ShapeError("disparity has shape " + shape_text(given) + ", expected (H, W)");
    if (!is_float(given))
      throw ShapeError("disparity has dtype " + py::str(given.dtype()).cast<std::string>() +
                       ", expected float32");
    array = contiguous<float>(given);
  }
};

/// float (rows, columns).
struct RangesArg {
  ContiguousArray<float> array;

  explicit RangesArg(py::handle source) {
    const py::array given = as_array(source, "ranges");
    if (given.ndim() != 2 || !is_float(given))
      throw ShapeError("ranges has shape " + shape_text(given) + " and dtype " +
                       py::str(given.dtype()).cast<std::string>() +
                       ", expected float32 (rows, columns)");
    array = contiguous<float>(given);
  }
  NearestRanges ranges() const {
    return {static_cast<int>(array.shape(0)),
            static_cast<int>(array.shape(1)),
            {array.data(), array.data() + array.size()}};
  }
};

/// float64, of any shape.
struct NumbersArg {
  ContiguousArray<double> array;

  explicit NumbersArg(py::handle source)
      : array(contiguous<double>(as_numbers(source, "numbers"))) {}
  std::span<const double> values() const {
    return {array.data(), static_cast<std::size_t>(array.size())};
  }
};

inline constexpr char projection_name[] = "projection";
inline constexpr char transform_name[] = "transform";
inline constexpr char camera_matrix_name[] = "camera_matrix";
inline constexpr char covariance_name[] = "covariance";
inline constexpr char rectification_name[] = "rectification";
using ProjectionArg = MatrixArg<3, 4, projection_name>;
using TransformArg = MatrixArg<4, 4, transform_name>;
using CameraMatrixArg = MatrixArg<3, 3, camera_matrix_name>;
using CovarianceArg = MatrixArg<6, 6, covariance_name>;
using RectificationArg = MatrixArg<3, 3, rectification_name>;

/// float (D,), or (N, D) for a table.
template <int Dimensions>
struct DescriptorsArg {
  ContiguousArray<float> array;

  explicit DescriptorsArg(py::handle source) {
    constexpr const char* name = Dimensions == 1 ? "descriptor" : "descriptors";
    const py::array given = as_array(source, name);
    if (given.ndim() != Dimensions)
      throw ShapeError(std::string(name) + " has shape " + shape_text(given) + ", expected " +
                       (Dimensions == 1 ? "(D,)" : "(N, D)"));
    if (!is_float(given))
      throw ShapeError(std::string(name) + " has dtype " +
                       py::str(given.dtype()).cast<std::string>() + ", expected float32");
    array = contiguous<float>(given);
  }
  std::span<const float> values() const {
    return {array.data(), static_cast<std::size_t>(array.size())};
  }
};

using DescriptorArg = DescriptorsArg<1>;
using DescriptorTableArg = DescriptorsArg<2>;

/// A vector given to numpy: it lives as long as the array.
template <class T>
py::array_t<T> to_numpy(std::vector<T>&& values, std::vector<py::ssize_t> shape) {
  auto owner = std::make_unique<std::vector<T>>(std::move(values));
  const T* data = owner->data();
  const py::capsule capsule(owner.release(),
                            [](void* p) { delete static_cast<std::vector<T>*>(p); });
  return py::array_t<T>(std::move(shape), data, capsule);
}

template <class T>
py::array_t<T> to_numpy(std::vector<T>&& values) {
  const auto size = static_cast<py::ssize_t>(values.size());
  return to_numpy(std::move(values), {size});
}

template <class T>
py::array_t<T> rows_of_three(std::vector<T>&& values) {
  const auto rows = static_cast<py::ssize_t>(values.size() / 3);
  return to_numpy(std::move(values), {rows, 3});
}

/// Runs `work`, which must not touch Python, without the GIL. Ctrl-C ends it: signals are looked
/// for while it runs (their handlers run on the main thread only, as Python has it).
template <class Work>
auto without_gil(Work&& work) {
  GilRelease release;
  const InterruptScope scope([&release] { return release.has_signal_raised(); });
  return work();
}

/// A part of what __getstate__ gave, for __setstate__. Throws DataError if it is another one.
template <class Value>
Value part_of_state(const py::object& state, std::size_t i, std::size_t parts, const char* name) {
  try {
    const auto all = state.cast<py::tuple>();
    if (py::isinstance<py::tuple>(state) && all.size() == parts) return all[i].cast<Value>();
  } catch (const py::cast_error&) {
    // refused below
  } catch (const py::reference_cast_error&) {  // None in the place of an object
  } catch (const py::error_already_set& error) {
    if (!error.matches(PyExc_TypeError)) throw;
  }
  throw DataError(std::string("state of ") + name + ": no " + std::to_string(parts) +
                  " parts of the kinds that it has");
}

void bind_descriptor_histograms(py::module_& module);
void bind_descriptors(py::module_& module);
void bind_descriptors_scans(py::module_& module);
void bind_fusion(py::module_& module);
void bind_mapping(py::module_& module);
void bind_matching(py::module_& module);
void bind_ratslam_experience_map(py::module_& module);
void bind_ratslam_pose_cells(py::module_& module);
void bind_registration(py::module_& module);
void bind_views_alignment(py::module_& module);
void bind_views_range_image(py::module_& module);
void bind_views_scene(py::module_& module);
void bind_views_similarity(py::module_& module);

/// The part of a scene's JSON that is its range image (views_range_image.cpp).
py::dict image_to_dict(const RangeImage& image);
/// Throws DataError for another dictionary.
RangeImage image_from_dict(const py::dict& entry);

}  // namespace fusionslam::bindings

namespace pybind11::detail {

/// Casts an array argument by its converting constructor; `Name` is what the stub shows.
template <class Arg>
struct array_arg_caster {
  template <class T>
  using cast_op_type = pybind11::detail::movable_cast_op_type<T>;
  operator Arg*() { return &*value; }
  operator Arg&() { return *value; }
  operator Arg&&() && { return std::move(*value); }

  bool load(handle source, bool) {
    // numpy lets go of the GIL while it converts.
    fusionslam::bindings::asleep_at_exit([&] { value.emplace(source); });
    return true;
  }
  std::optional<Arg> value;
};

#define FUSIONSLAM_ARRAY_ARG(Arg, type)                                        \
  template <>                                                                  \
  struct type_caster<Arg> : array_arg_caster<Arg> {                            \
    static constexpr auto name = const_name("numpy.typing.NDArray[" type "]"); \
  }

FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::PointsArg, "numpy.float32");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::ColorsArg, "numpy.uint8");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::IntensitiesArg, "numpy.float32");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::ImageArg, "numpy.uint8");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::DisparityArg, "numpy.float32");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::RangesArg, "numpy.float32");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::ProjectionArg, "numpy.float64");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::TransformArg, "numpy.float64");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::CameraMatrixArg, "numpy.float64");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::CovarianceArg, "numpy.float64");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::RectificationArg, "numpy.float64");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::DistortionArg, "numpy.float64");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::NumbersArg, "numpy.float64");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::DescriptorArg, "numpy.float32");
FUSIONSLAM_ARRAY_ARG(fusionslam::bindings::DescriptorTableArg, "numpy.float32");

#undef FUSIONSLAM_ARRAY_ARG

}  // namespace pybind11::detail
