// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The compiled half of the Python package: table of contents and errors.
#include "common.hpp"

namespace fusionslam::bindings {
namespace {

void raise(const char* name, const char* message) {
  const py::object type = py::module_::import("fusionslam.errors").attr(name);
  PyErr_SetString(type.ptr(), message);
}

void translate_errors() {
  py::register_exception_translator([](std::exception_ptr failure) {
    try {
      std::rethrow_exception(failure);
    } catch (const DataError& error) {
      raise("DataError", error.what());
    } catch (const ConfigError& error) {
      raise("ConfigError", error.what());
    } catch (const ShapeError& error) {
      raise("ShapeError", error.what());
    }
  });
}

}  // namespace

PYBIND11_MODULE(_core, module) {
  module.doc() = "The C++ core of fusionslam; its public names are those of the package.";
  module.attr("__version__") = FUSIONSLAM_VERSION;
  translate_errors();
  bind_fusion(module);
  bind_descriptors(module);
  bind_matching(module);
}

}  // namespace fusionslam::bindings
