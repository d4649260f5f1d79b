// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "common.hpp"
#include "configuration.hpp"
#include "shared_index.hpp"

namespace fusionslam::bindings {
namespace {

using SharedScenes = SharedIndex<AlignmentIndex>;
using IndexState = py::typing::Tuple<AlignmentConfig, py::typing::List<RangeImage>>;

py::typing::Dict<py::str, py::float_> evidence_of(const Alignment& alignment) {
  py::typing::Dict<py::str, py::float_> evidence;
  for (std::size_t i = 0; i < AlignmentEvidence::size; ++i) {
    const std::string_view name = AlignmentEvidence::names[i];
    evidence[py::str(name.data(), name.size())] = alignment.evidence.values[i];
  }
  return evidence;
}

Alignment alignment_from_state(const py::object& state) {
  constexpr const char* name = "an alignment";
  constexpr std::size_t parts = 6;
  const auto number = [&](std::size_t i) { return part_of_state<double>(state, i, parts, name); };
  Alignment alignment{number(0), number(1), number(2), number(3), {}, {}};
  alignment.evidence.values =
      part_of_state<decltype(AlignmentEvidence::values)>(state, 4, parts, name);
  alignment.information = part_of_state<decltype(Alignment::information)>(state, 5, parts, name);
  const auto& evidence = alignment.evidence.values;
  const auto finite = [](const auto& values) {
    return std::all_of(values.begin(), values.end(), [](double one) { return std::isfinite(one); });
  };
  if (!std::isfinite(alignment.x + alignment.y + alignment.yaw) ||
      !(alignment.probability >= 0 && alignment.probability <= 1) || !finite(evidence) ||
      !finite(alignment.information))
    throw DataError("state of an alignment: a number is not finite, or no probability");
  return alignment;
}

AlignmentConfig config_of(const SharedScenes& self) {
  return self.read([](const AlignmentIndex& index) { return index.config(); });
}

/// The configuration and the range image of each scene.
IndexState state_of(const SharedScenes& self) {
  AlignmentConfig config;
  const auto images = self.read([&](const AlignmentIndex& index) {
    config = index.config();
    std::vector<RangeImage> all;
    for (std::size_t i = 0; i < index.size(); ++i) all.push_back(index.image(i));
    return all;
  });
  return py::make_tuple(config, images);
}

std::unique_ptr<SharedScenes> index_from_state(const py::object& state) {
  constexpr const char* name = "an alignment index";
  AlignmentIndex index(part_of_state<AlignmentConfig>(state, 0, 2, name));
  for (RangeImage& image : part_of_state<std::vector<RangeImage>>(state, 1, 2, name))
    index.add({{}, std::move(image)});
  return std::make_unique<SharedScenes>(std::move(index));
}

void bind_result(py::module_& module) {
  py::class_<Alignment>(module, "Alignment", "The alignment of one scene with another.")
      .def_readonly("x", &Alignment::x,
                    "x of the current robot in the frame of the stored one, metres.")
      .def_readonly("y", &Alignment::y, "Metres.")
      .def_readonly("yaw", &Alignment::yaw, "Radians.")
      .def_readonly("probability", &Alignment::probability,
                    "Probability that both scans were taken within 0.8 m and 22.9 deg of each "
                    "other; 0 beyond "
                    "reach and turn of the configuration.")
      .def_property_readonly("evidence", &evidence_of,
                             "The numbers from which the probability is computed, by name.")
      .def_property_readonly(
          "information",
          [](const Alignment& self) {
            return to_numpy(std::vector<double>(self.information.begin(), self.information.end()),
                            {3, 3});
          },
          "float64 (3, 3): information of x, y, yaw in metres and radians, as if the residuals of "
          "the cells were independent; zeros if nothing could be aligned.")
      .def("__repr__",
           [](const Alignment& self) {
             std::ostringstream text;
             text << "<Alignment x " << self.x << " m, y " << self.y << " m, yaw " << self.yaw
                  << " rad, probability " << self.probability << '>';
             return text.str();
           })
      .def(py::pickle(
          [](const Alignment& self) {
            return py::make_tuple(self.x, self.y, self.yaw, self.probability, self.evidence.values,
                                  self.information);
          },
          &alignment_from_state));
}

void bind_functions(py::module_& module) {
  using namespace py::literals;
  module.def(
      "align_scenes",
      [](const Scene& current, const Scene& stored, const std::optional<AlignmentConfig>& config) {
        return without_gil(
            [&] { return align_scenes(current, stored, config.value_or(AlignmentConfig{})); });
      },
      "current"_a, "stored"_a, py::kw_only(), "config"_a = py::none(),
      R"(Aligns two scenes' range images and computes the probability that they show one place.

Point-to-plane ICP with projective data association, in the plane, from several starts. The
probability is calibrated: docs/stages/views/alignment.md says on what.

Args:
    config: an AlignmentConfig.

Returns:
    An Alignment; of probability 0 if a scene has no range image, or one of fewer than ten cells.)");
}

void bind_index(py::module_& module) {
  using namespace py::literals;
  py::class_<SharedScenes>(
      module, "AlignmentIndex",
      R"(Stored scenes; those that look like the current one are aligned with it.

They are numbered from 0 in the order in which they were added. Threads may share an index.)")
      .def(py::init([](const std::optional<AlignmentConfig>& config) {
             return std::make_unique<SharedScenes>(
                 AlignmentIndex(config.value_or(AlignmentConfig{})));
           }),
           "config"_a = py::none())
      .def(
          "add",
          [](SharedScenes& self, const Scene& scene) {
            return self.write([&](AlignmentIndex& index) { return index.add(scene); });
          },
          "scene"_a, "Stores a scene and returns its number.")
      .def(
          "remove",
          [](SharedScenes& self, std::size_t number) {
            self.write([&](AlignmentIndex& index) { index.remove(number); });
          },
          "number"_a,
          "Removes a scene; the numbers of all later ones fall by one. Raises ConfigError if there "
          "is none.")
      .def(
          "query",
          [](const SharedScenes& self, const Scene& current, int threads) {
            std::vector<std::pair<std::size_t, Alignment>> found;
            for (AlignedScene& scene : self.read(
                     [&](const AlignmentIndex& index) { return index.query(current, threads); }))
              found.emplace_back(scene.number, scene.alignment);
            return found;
          },
          "current"_a, py::kw_only(), "threads"_a = 1,
          R"(The stored scenes most similar to the current one, each aligned with it.

Args:
    threads: of this call; 0 is one a core. The result does not depend on it.

Returns:
    list of (number, Alignment), most probable first, of equal ones the lowest number first.)")
      .def(
          "query_near",
          [](const SharedScenes& self, const Scene& current, const std::vector<std::size_t>& near,
             std::size_t most, int threads) {
            std::vector<std::pair<std::size_t, Alignment>> found;
            for (AlignedScene& scene : self.read([&](const AlignmentIndex& index) {
                   return index.query_near(current, near, most, threads);
                 }))
              found.emplace_back(scene.number, scene.alignment);
            return found;
          },
          "current"_a, "near"_a, "most"_a, py::kw_only(), "threads"_a = 1,
          R"(As query, with at most so many scenes: those near, and the most similar others.

Args:
    near: numbers of scenes that are aligned however much they differ in their thumbnails.
    most: of all scenes that are aligned.

Raises:
    ConfigError: a number that is not stored.)")
      .def("__len__",
           [](const SharedScenes& self) {
             return self.read([](const AlignmentIndex& index) { return index.size(); });
           })
      .def_property_readonly("config", &config_of)
      .def(py::pickle(&state_of, &index_from_state));
}

}  // namespace

void bind_views_alignment(py::module_& module) {
  bind_config<AlignmentConfig>(module, "AlignmentConfig", "How scenes are aligned.")
      .def(py::init(
          [](const Options& options) { return with_options(AlignmentConfig{}, options); }));
  bind_result(module);
  bind_functions(module);
  bind_index(module);
}

}  // namespace fusionslam::bindings
