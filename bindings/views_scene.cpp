// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <string_view>
#include <tuple>

#include "common.hpp"
#include "configuration.hpp"

namespace fusionslam::bindings {
namespace {

constexpr int json_version = 1;

using Reduced = py::typing::Tuple<py::type, py::typing::Tuple<py::array, RangeImage>>;

/// Calls visit(name, value) with the parts of an object that JSON holds.
template <class Object, class Visit>
void visit_parts(Object& object, Visit&& visit) {
  visit("points", object.points);
  visit("center", object.center);
  visit("volume", object.volume);
  visit("area", object.area);
  visit("color", object.color);
  visit("extents", object.extents);
  visit("box_min", object.box_min);
  visit("box_max", object.box_max);
}

bool same(const Scene& a, const Scene& b) {
  const auto parts = [](const SceneObject& o) {
    return std::tie(o.points, o.center, o.volume, o.area, o.color, o.extents, o.box_min, o.box_max);
  };
  return a.image == b.image &&
         std::equal(a.objects.begin(), a.objects.end(), b.objects.begin(), b.objects.end(),
                    [&](const auto& x, const auto& y) { return parts(x) == parts(y); });
}

/// A read-only view that keeps the scene alive.
py::array objects_of(const py::object& self) {
  const auto& objects = self.cast<const Scene&>().objects;
  py::array_t<SceneObject> array({static_cast<py::ssize_t>(objects.size())}, objects.data(), self);
  array.attr("flags").attr("writeable") = false;
  return array;
}

template <class Values>
void check_finite(const Values& values, const char* name, std::size_t index) {
  for (const double value : values)
    if (!std::isfinite(value))
      throw DataError("object " + std::to_string(index) + ": " + name + " is not finite");
}

/// Throws DataError for a scene that no cloud gives.
Scene check_scene(Scene&& scene) {
  for (std::size_t i = 0; i < scene.objects.size(); ++i) {
    SceneObject& object = scene.objects[i];
    if (object.points < 1)
      throw DataError("object " + std::to_string(i) + ": points is " +
                      std::to_string(object.points) + ", expected at least 1");
    visit_parts(object, [&](const char* name, auto& value) {
      using Value = std::decay_t<decltype(value)>;
      if constexpr (std::is_same_v<Value, double>)
        check_finite(std::array{value}, name, i);
      else if constexpr (!std::is_integral_v<Value>)
        check_finite(value, name, i);
    });
  }
  return std::move(scene);
}

Scene scene_from_array(const py::object& objects, const std::optional<RangeImage>& image) {
  const py::array given = as_array(objects, "objects");
  if (given.ndim() != 1 || !given.dtype().equal(py::dtype::of<SceneObject>()))
    throw ShapeError(
        "objects is no array like Scene.objects: one dimension, fields center, "
        "volume, area, color, extents, box_min, box_max, points");
  const auto array = contiguous<SceneObject>(given);
  return check_scene({{array.data(), array.data() + array.size()}, image.value_or(RangeImage{})});
}

std::string to_json(const Scene& scene) {
  const py::object dumps = py::module_::import("json").attr("dumps");
  std::string text = "{\"version\": " + std::to_string(json_version) + ", \"objects\": [";
  for (const SceneObject& object : scene.objects) {
    py::dict entry;
    visit_parts(object, [&](const char* name, const auto& value) { entry[name] = value; });
    text += (&object == scene.objects.data() ? "\n  " : ",\n  ") + dumps(entry).cast<std::string>();
  }
  text += "\n]";
  if (!scene.image.cells.empty())
    text += ",\n\"image\": " + dumps(image_to_dict(scene.image)).cast<std::string>();
  return text + "}\n";
}

SceneObject object_from_entry(const py::dict& entry, std::size_t index) {
  SceneObject object;
  visit_parts(object, [&](const char* name, auto& value) {
    const std::string where = "JSON of a scene, object " + std::to_string(index) + ": ";
    if (!entry.contains(name)) throw DataError(where + "no " + name);
    try {
      value = entry[name].template cast<std::decay_t<decltype(value)>>();
    } catch (const py::cast_error&) {
      throw DataError(where + name + " is " + py::repr(entry[name]).template cast<std::string>());
    }
  });
  return object;
}

py::dict parse_json(const std::string& text) {
  py::object whole;
  try {
    whole = py::module_::import("json").attr("loads")(text);
  } catch (py::error_already_set& error) {
    if (!error.matches(PyExc_ValueError) && !error.matches(PyExc_RecursionError)) throw;
    throw DataError("JSON of a scene: " + py::str(error.value()).cast<std::string>());
  }
  if (!py::isinstance<py::dict>(whole) || !whole.contains("version") ||
      !whole.contains("objects") || !py::isinstance<py::list>(whole["objects"]))
    throw DataError("JSON of a scene: expected an object with version and objects");
  return whole;
}

Scene from_json(const std::string& text) {
  const py::dict whole = parse_json(text);
  if (!py::object(whole["version"]).equal(py::int_(json_version)))
    throw DataError("JSON of a scene: version " + py::repr(whole["version"]).cast<std::string>() +
                    ", this program reads version " + std::to_string(json_version));
  Scene scene;
  for (const py::handle entry : py::list(whole["objects"])) {
    if (!py::isinstance<py::dict>(entry))
      throw DataError("JSON of a scene, object " + std::to_string(scene.objects.size()) +
                      ": expected names with values");
    scene.objects.push_back(
        object_from_entry(py::reinterpret_borrow<py::dict>(entry), scene.objects.size()));
  }
  if (whole.contains("image")) {
    if (!py::isinstance<py::dict>(whole["image"]))
      throw DataError("JSON of a scene: its image is none");
    scene.image = image_from_dict(whole["image"]);
  }
  return check_scene(std::move(scene));
}

py::bytes to_bytes(const Scene& scene, bool image) {
  const auto bytes = scene_to_bytes(scene, image);
  return py::bytes(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

Scene from_bytes(const py::bytes& bytes) {
  const std::string_view text(bytes);
  return scene_from_bytes({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

void bind_scene(py::module_& module) {
  using namespace py::literals;
  PYBIND11_NUMPY_DTYPE(SceneObject, center, volume, area, color, extents, box_min, box_max, points);
  py::class_<Scene>(module, "Scene", R"(The objects of a cloud (Stastny 2022, 4.5).

Scenes are values: they do not change, and are equal if all their objects are.)")
      .def(py::init(&scene_from_array), "objects"_a, "image"_a = py::none(),
           R"(A scene of given objects, in their order: an array like `objects`.

Raises:
    ShapeError: another kind of array. DataError: NaN, infinity or an object without points.)")
      .def_property_readonly("objects", &objects_of,
                             R"(Read-only structured array, one row an object, those with most
points first; fields center (3) m, volume m3, area m2 (of the hull), color (3) RGB 0 to 255,
extents (3) m along the principal axes, box_min (3), box_max (3) m, points.)")
      .def_readonly("image", &Scene::image,
                    "The RangeImage, without cells if the configuration asked for none.")
      .def("__len__", [](const Scene& self) { return self.objects.size(); })
      .def("__eq__",
           [](const Scene& self, const py::object& other) {
             return py::isinstance<Scene>(other) && same(self, other.cast<const Scene&>());
           })
      .def("__repr__",
           [](const Scene& self) {
             return "<Scene of " + std::to_string(self.objects.size()) + " objects>";
           })
      .def("to_json", &to_json, "The scene as JSON, exact, one line an object.")
      .def_static("from_json", &from_json, "text"_a, R"(The scene that to_json wrote.

Raises:
    DataError: no JSON, no scene, or one of another version.)")
      .def("to_bytes", &to_bytes, py::kw_only(), "image"_a = true,
           R"(The scene in few bytes: about 25 an object and 12 a scene.

Similarities under every preset stay within 1e-4: centres and extents are kept to 0.05 mm, volumes
to 0.01 dm3, areas to 1 cm2, colours to 1/2048 of a byte, numbers of points exactly. Boxes are not
kept.

Raises:
    DataError: values that do not fit, such as centres beyond 4e11 m.)")
      .def_static(
          "from_bytes", &from_bytes, "data"_a,
          R"(The scene that to_bytes wrote; box_min and box_max of its objects are their centres.

Raises:
    DataError: bytes that are truncated, damaged, foreign or of another version.)")
      .def("__hash__",
           [](const Scene& self) {
             std::size_t value = self.objects.size();
             for (const SceneObject& object : self.objects)
               value = 31 * value + static_cast<std::size_t>(object.points);
             return value;
           })
      .def("__reduce__", [](const py::object& self) -> Reduced {
        return py::make_tuple(py::type::of(self),
                              py::make_tuple(self.attr("objects"), self.attr("image")));
      });
}

using LabelArray = py::array_t<std::int32_t>;

LabelArray labels_of(const PointsArg& points, const std::optional<ColorsArg>& colors,
                     const DbscanConfig& config) {
  const ColorsView view = colors ? colors->view() : ColorsView{};
  if (colors && view.size != points.view().size)
    throw ShapeError("colors has " + std::to_string(view.size) + " rows, points has " +
                     std::to_string(points.view().size));
  return to_numpy(without_gil([&] { return dbscan(points.view(), view, config); }));
}

}  // namespace

void bind_views_scene(py::module_& module) {
  using namespace py::literals;
  const DbscanConfig standard;
  module.def(
      "dbscan",
      [](const PointsArg& points, const std::optional<ColorsArg>& colors, double eps,
         int min_points, double color_scale, bool inclusive) {
        return labels_of(points, colors, {eps, min_points, color_scale, inclusive});
      },
      "points"_a, "colors"_a = py::none(), py::kw_only(), "eps"_a, "min_points"_a,
      "color_scale"_a = standard.color_scale, "inclusive"_a = standard.inclusive,
      R"(Clusters of points by density in (x, y, z, s r, s g, s b) (Ester et al. 1996).

Args:
    points: float32 (N, 3), metres, any frame.
    colors: uint8 (N, 3), RGB; None clusters in x, y, z only.
    eps: radius of a neighbourhood, metres.
    min_points: neighbours that make a point a core point, itself among them.
    color_scale: s, metres a step of a colour channel.
    inclusive: whether a point exactly eps away is a neighbour (as in scikit-learn).

Returns:
    int32 (N,): clusters from 0 in the order of their first core points, -1 for noise. A border
    point belongs to the first of the clusters that reach it.

Raises:
    DataError: NaN or infinity. ShapeError: wrong arrays. ConfigError: values out of range.)");
  bind_config<SceneConfig>(module, "SceneConfig", "How a coloured cloud becomes a scene.")
      .def(py::init([](const std::string& preset, const Options& options) {
             return with_options(scene_preset(preset), options);
           }),
           py::kw_only(), py::arg("preset") = "robust",
           "The preset's values, with the given options in their place.");
  bind_scene(module);
  module.def(
      "build_scene",
      [](const PointsArg& points, const std::optional<ColorsArg>& colors, const std::string& preset,
         const std::optional<SceneConfig>& config) {
        if (!colors) throw DataError("build_scene needs colours and the cloud has none");
        const SceneConfig settings = config ? *config : scene_preset(preset);
        return without_gil([&] { return build_scene(points.view(), colors->view(), settings); });
      },
      "points"_a, "colors"_a, py::kw_only(), "preset"_a = "robust", "config"_a = py::none(),
      R"(The objects of a cloud: clusters, and the convex hull of each (Stastny 2022, 4.5).

Args:
    points: float32 (N, 3), metres, without ground.
    colors: uint8 (N, 3), RGB.
    preset: "robust" (default), "paper" (the thesis's text) or "author" (its program).
    config: a SceneConfig, used instead of the preset.

Returns:
    Scene, without objects for a cloud without clusters or points.

Raises:
    DataError: NaN, infinity, no colours. ShapeError: wrong arrays. ConfigError: unknown preset.)");
}

}  // namespace fusionslam::bindings
