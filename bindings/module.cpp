// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The compiled half of the Python package: table of contents and errors.
#include "common.hpp"

namespace fusionslam::bindings {
namespace {

using namespace py::literals;

/// A path need not be UTF-8.
py::str text_of(const std::string& bytes) {
  return py::reinterpret_steal<py::str>(
      PyUnicode_DecodeFSDefaultAndSize(bytes.data(), static_cast<py::ssize_t>(bytes.size())));
}

template <class... Options>
void raise(const char* name, const char* message, Options&&... options) {
  const py::object type = py::module_::import("fusionslam.errors").attr(name);
  const py::object error = type(text_of(message), std::forward<Options>(options)...);
  PyErr_SetObject(type.ptr(), error.ptr());
}

void translate_errors() {
  py::register_exception_translator([](std::exception_ptr failure) {
    try {
      std::rethrow_exception(failure);
    } catch (const WriteError& error) {
      raise("DataError", error.what(), "code"_a = "cannot-write",
            "fields"_a = py::make_tuple(text_of(error.path())));
    } catch (const DataError& error) {
      raise("DataError", error.what());
    } catch (const ConfigError& error) {
      raise("ConfigError", error.what());
    } catch (const ShapeError& error) {
      raise("ShapeError", error.what());
    } catch (const Interrupted&) {
      // The signal's handler may already have set an exception.
      if (!PyErr_Occurred()) PyErr_SetNone(PyExc_KeyboardInterrupt);
    }
  });
}

}  // namespace

PYBIND11_MODULE(_core, module) {
  module.doc() = "The C++ core of fusionslam; its public names are those of the package.";
  module.attr("__version__") = FUSIONSLAM_VERSION;
  translate_errors();
  module.def(
      "simd_level", [] { return std::string(choice_name(simd_level())); },
      R"(Name of the instruction set the hot loops use: baseline, avx2 or avx512.

It is the best the machine has, or what the environment variable FUSIONSLAM_SIMD said at the first
use. Results do not depend on it.

Raises:
    ConfigError: FUSIONSLAM_SIMD names no level, or one this machine lacks.)");
  bind_fusion(module);
  bind_descriptors(module);
  bind_descriptor_histograms(module);
  bind_mapping(module);
  bind_matching(module);
  bind_views_range_image(module);
  bind_views_scene(module);
  bind_views_similarity(module);
  bind_views_alignment(module);
  bind_ratslam_pose_cells(module);
  bind_ratslam_experience_map(module);
  bind_registration(module);
}

}  // namespace fusionslam::bindings
