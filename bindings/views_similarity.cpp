// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <array>

#include "common.hpp"
#include "configuration.hpp"
#include "shared_index.hpp"

namespace fusionslam::bindings {
namespace {

using SharedScenes = SharedIndex<SceneIndex>;
using OptionalConfig = std::optional<SimilarityConfig>;

SimilarityConfig chosen(const OptionalConfig& config, const std::string& preset) {
  return config ? *config : similarity_preset(preset);
}

std::array<double, 3> three_numbers(py::handle source, const char* name) {
  const py::array given = as_numbers(source, name);
  if (given.ndim() != 1 || given.shape(0) != 3)
    throw ShapeError(std::string(name) + " has shape " + shape_text(given) + ", expected (3,)");
  const auto array = contiguous<double>(given);
  return {array.at(0), array.at(1), array.at(2)};
}

std::size_t number_of(py::ssize_t number) {
  if (number < 0) throw ConfigError("scene " + std::to_string(number) + " is not stored");
  return static_cast<std::size_t>(number);
}

void bind_colors(py::module_& module) {
  using namespace py::literals;
  module.def(
      "color_difference",
      [](const py::object& a, const py::object& b, const std::string& kind) {
        return color_difference(three_numbers(a, "a"), three_numbers(b, "b"),
                                choice_from_name<ColorDifference>("kind", kind));
      },
      "a"_a, "b"_a, "kind"_a = "ciede2000",
      R"(The difference of two colours.

Args:
    a, b: RGB, three numbers from 0 to 255.
    kind: "ciede2000" or "cie76" (L*a*b* of sRGB with white D65), "rgb" (Euclidean distance) or
        "author" (sqrt(3) times the difference of red, as the program of Stastny 2022 has it).

Raises:
    DataError: NaN, or channels outside. ShapeError: not three numbers. ConfigError: unknown kind.)");
  module.def(
      "ciede2000",
      [](const py::object& a, const py::object& b) {
        return ciede2000(three_numbers(a, "a"), three_numbers(b, "b"));
      },
      "a"_a, "b"_a,
      R"(CIEDE2000 of two colours (L*, a*, b*), all factors 1 (Sharma, Wu, Dalal 2005).

Raises:
    DataError: NaN or infinity. ShapeError: not three numbers.)");
}

void bind_functions(py::module_& module) {
  using namespace py::literals;
  module.def(
      "scene_similarity",
      [](const Scene& current, const Scene& stored, const std::string& preset,
         const OptionalConfig& config) {
        const SimilarityConfig settings = chosen(config, preset);
        return without_gil([&] { return scene_similarity(current, stored, settings); });
      },
      "current"_a, "stored"_a, py::kw_only(), "preset"_a = "robust", "config"_a = py::none(),
      R"(The similarity of two scenes, 0 to 1 (Stastny 2022, 4.6).

Every object of the current scene takes its best similarity to an object of the stored one; the
mean of these, weighted by numbers of points, is the similarity. The robust preset takes the mean
with the same seen from the stored scene. Two empty scenes are alike (1), one empty one is not (0).

Args:
    preset: "robust" (default), "paper" or "author".
    config: a SimilarityConfig, used instead of the preset.

Raises:
    ConfigError: unknown preset, all weights 0. DataError: an object that is not finite.)");
}

SimilarityConfig config_of(const SharedScenes& self) {
  return self.read([](const SceneIndex& index) { return index.config(); });
}

std::unique_ptr<SharedScenes> index_from_state(const py::object& state) {
  constexpr const char* name = "a scene index";
  SceneIndex index(part_of_state<SimilarityConfig>(state, 0, 3, name));
  index.restore({part_of_state<std::vector<std::uint64_t>>(state, 1, 3, name),
                 part_of_state<std::vector<double>>(state, 2, 3, name)});
  return std::make_unique<SharedScenes>(std::move(index));
}

void bind_index(py::module_& module) {
  using namespace py::literals;
  py::class_<SharedScenes>(module, "SceneIndex",
                           R"(Many stored scenes, compared with one in a single call.

They are numbered from 0 in the order in which they were added. Threads may share an index.)")
      .def(py::init([](const OptionalConfig& config, const std::string& preset) {
             return std::make_unique<SharedScenes>(SceneIndex(chosen(config, preset)));
           }),
           "config"_a = py::none(), py::kw_only(), "preset"_a = "robust",
           "Uses the configuration or, without one, the preset.")
      .def(
          "add",
          [](SharedScenes& self, const Scene& scene) {
            return self.write([&](SceneIndex& index) { return index.add(scene); });
          },
          "scene"_a, "Stores a scene and returns its number. Raises DataError if it holds NaN.")
      .def(
          "replace",
          [](SharedScenes& self, py::ssize_t number, const Scene& scene) {
            const std::size_t place = number_of(number);
            self.write([&](SceneIndex& index) { index.replace(place, scene); });
          },
          "number"_a, "scene"_a, "Replaces a stored scene. Raises ConfigError if there is none.")
      .def(
          "remove",
          [](SharedScenes& self, py::ssize_t number) {
            const std::size_t place = number_of(number);
            self.write([&](SceneIndex& index) { index.remove(place); });
          },
          "number"_a,
          "Removes a scene; the numbers of all later ones fall by one. Raises ConfigError if there "
          "is none.")
      .def(
          "similarities",
          [](const SharedScenes& self, const Scene& current, int threads) {
            return to_numpy(self.read(
                [&](const SceneIndex& index) { return index.similarities(current, threads); }));
          },
          "current"_a, py::kw_only(), "threads"_a = 1,
          R"(scene_similarity(current, stored) of every stored scene, float64 (n,), to 1e-6.

Args:
    threads: of this call; 0 is one a core. The result does not depend on it.

Raises:
    DataError: an object that is not finite.)")
      .def("__len__",
           [](const SharedScenes& self) {
             return self.read([](const SceneIndex& index) { return index.size(); });
           })
      .def_property_readonly("config", &config_of)
      .def(py::pickle(
          [](const SharedScenes& self) {
            SceneIndexState state =
                self.read([](const SceneIndex& index) { return index.state(); });
            return py::make_tuple(config_of(self), to_numpy(std::move(state.ends)),
                                  to_numpy(std::move(state.values)));
          },
          &index_from_state));
}

}  // namespace

void bind_views_similarity(py::module_& module) {
  bind_config<SimilarityConfig>(module, "SimilarityConfig", "How scenes are compared.")
      .def(py::init([](const std::string& preset, const Options& options) {
             return with_options(similarity_preset(preset), options);
           }),
           py::kw_only(), py::arg("preset") = "robust",
           "The preset's values, with the given options in their place.");
  bind_colors(module);
  bind_functions(module);
  bind_index(module);
}

}  // namespace fusionslam::bindings
