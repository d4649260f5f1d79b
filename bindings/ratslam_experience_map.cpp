// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <pybind11/native_enum.h>

#include "configuration.hpp"
#include "shared_index.hpp"

namespace fusionslam::bindings {
namespace {

using SharedMap = SharedIndex<ExperienceMap>;
using PoseTuple = py::typing::Tuple<double, double, double>;
using CheckTuple = py::typing::Tuple<bool, double, double, double, double, py::str>;
using RelaxationTuple = py::typing::Tuple<double, double, double, std::int64_t, std::int64_t, bool>;
using StateDict = py::typing::Dict<py::str, py::array>;

PoseTuple tuple_of(const Pose2& pose) { return py::make_tuple(pose.x, pose.y, pose.heading); }

CheckTuple tuple_of(const LoopCheck& check) {
  return py::make_tuple(check.accepted, check.error_m, check.error_rad, check.allowed_m,
                        check.allowed_rad, check.reason);
}

RelaxationTuple tuple_of(const Relaxation& done) {
  return py::make_tuple(done.residual_m, done.residual_rad, done.step_m, done.sweeps, done.nodes,
                        done.settled);
}

MapAction action_of(int kind, std::int64_t source, std::int64_t target, double rotation,
                    const std::pair<double, double>& place) {
  if (kind < 0 || kind > 2)
    throw DataError("action of kind " + std::to_string(kind) + ", expected 0, 1 or 2");
  return {static_cast<ActionKind>(kind), source, target, rotation, place.first, place.second};
}

std::vector<double> nodes_of(const ExperienceMap& map) {
  std::vector<double> values;
  values.reserve(3 * map.size());
  for (std::size_t i = 0; i < map.size(); ++i) {
    const Pose2 node = map.node(i);
    values.insert(values.end(), {node.x, node.y, node.heading});
  }
  return values;
}

std::vector<MapLink> links_of(const ExperienceMap& map) {
  std::vector<MapLink> links;
  links.reserve(map.links());
  for (std::size_t i = 0; i < map.links(); ++i) links.push_back(map.link(i));
  return links;
}

StateDict arrays_of(MapState&& state) {
  const auto rows = []<class T>(std::vector<T>&& values, std::size_t width) {
    const auto count = static_cast<py::ssize_t>(values.size() / width);
    return to_numpy(std::move(values), {count, static_cast<py::ssize_t>(width)});
  };
  StateDict arrays;
  arrays["nodes"] = rows(std::move(state.nodes), 3);
  arrays["ends"] = rows(std::move(state.ends), 2);
  arrays["links"] = rows(std::move(state.links), MapState::link_values);
  arrays["loops"] = to_numpy(std::move(state.loops));
  arrays["robot"] = to_numpy(std::move(state.robot));
  arrays["counts"] = to_numpy(std::move(state.counts));
  arrays["due"] = to_numpy(std::move(state.due));
  arrays["pending_ends"] = rows(std::move(state.pending_ends), 2);
  arrays["pending"] = rows(std::move(state.pending), MapState::pending_values);
  arrays["interruptions"] = to_numpy(std::move(state.interruptions));
  return arrays;
}

template <class T>
void take(const py::dict& arrays, const char* name, std::vector<T>& values) {
  if (!arrays.contains(name))
    throw DataError(std::string("state of an experience map: no array '") + name + "'");
  const py::array given = as_array(arrays[name], name);
  if (!given.dtype().equal(py::dtype::of<T>()))
    throw DataError(std::string("state of an experience map: ") + name + " has dtype " +
                    py::str(given.dtype()).cast<std::string>() + ", expected " +
                    py::str(py::dtype::of<T>()).cast<std::string>());
  const auto array = contiguous<T>(given);
  values.assign(array.data(), array.data() + array.size());
}

MapState state_of(const py::dict& arrays) {
  MapState state;
  take(arrays, "nodes", state.nodes);
  take(arrays, "ends", state.ends);
  take(arrays, "links", state.links);
  take(arrays, "loops", state.loops);
  take(arrays, "robot", state.robot);
  take(arrays, "counts", state.counts);
  take(arrays, "due", state.due);
  take(arrays, "pending_ends", state.pending_ends);
  take(arrays, "pending", state.pending);
  take(arrays, "interruptions", state.interruptions);
  return state;
}

void bind_changes(py::class_<SharedMap>& bound) {
  using namespace py::literals;
  bound
      .def(
          "on_odometry",
          [](SharedMap& self, double v, double w, double dt) {
            self.write([&](ExperienceMap& map) { map.on_odometry(v, w, dt); });
          },
          "v"_a, "w"_a, "dt"_a, "Moves on: metres and radians a second, seconds.")
      .def(
          "mark_interruption",
          [](SharedMap& self) { self.write([](ExperienceMap& map) { map.mark_interruption(); }); },
          "Notes that the robot may have been carried since odometry's last pose.")
      .def(
          "mark_interruption_before",
          [](SharedMap& self, std::int64_t node) {
            self.write([&](ExperienceMap& map) { map.mark_interruption_before(node); });
          },
          "node"_a, "Notes that the robot may have been carried before a node was made.")
      .def(
          "rescale_odometry",
          [](SharedMap& self, double way, double turn) {
            self.write([&](ExperienceMap& map) { map.rescale_odometry(way, turn); });
          },
          "way"_a, "turn"_a, "Multiplies what odometry has measured so far by factors.")
      .def(
          "set_odometry_deviations",
          [](SharedMap& self, double way, double turn) {
            self.write([&](ExperienceMap& map) { map.set_odometry_deviations(way, turn); });
          },
          "way"_a, "turn"_a, "Standard deviations of the factors that odometry may be off by.")
      .def(
          "check",
          [](SharedMap& self, int kind, std::int64_t source, std::int64_t target, double rotation,
             const std::pair<double, double>& place) {
            const MapAction action = action_of(kind, source, target, rotation, place);
            return tuple_of(self.write_long([&](auto& map) { return map.check(action); }));
          },
          "kind"_a, "source"_a, "target"_a, "relative_rotation"_a, "relative_place"_a,
          "Whether a loop fits odometry: the values of LoopCheck.")
      .def(
          "apply",
          [](SharedMap& self, int kind, std::int64_t source, std::int64_t target, double rotation,
             const std::pair<double, double>& place) {
            const MapAction action = action_of(kind, source, target, rotation, place);
            self.write_long([&](auto& map) { map.apply(action); });
          },
          "kind"_a, "source"_a, "target"_a, "relative_rotation"_a, "relative_place"_a,
          "Does what the pose cells say.")
      .def(
          "relax",
          [](SharedMap& self, bool whole) {
            return tuple_of(self.write_long([&](ExperienceMap& map) { return map.relax(whole); }));
          },
          "whole"_a, "Moves nodes until links fit: the values of Relaxation.")
      .def(
          "restore",
          [](SharedMap& self, const StateDict& arrays) {
            const MapState state = state_of(arrays);
            self.write([&](ExperienceMap& map) { map.restore(state); });
          },
          "state"_a, "Puts the map into a state that state() gave.");
}

void bind_values(py::class_<SharedMap>& bound) {
  const auto read = [](auto work) {
    return [work](const SharedMap& self) { return self.read(work); };
  };
  bound.def("__len__", read([](const ExperienceMap& map) { return map.size(); }))
      .def_property_readonly("current",
                             read([](const ExperienceMap& map) { return map.current(); }))
      .def_property_readonly(
          "nodes", [](const SharedMap& self) { return rows_of_three(self.read(nodes_of)); })
      .def_property_readonly(
          "links", [](const SharedMap& self) -> py::array { return to_numpy(self.read(links_of)); })
      .def_property_readonly(
          "pose",
          [](const SharedMap& self) {
            return tuple_of(self.read([](const auto& map) { return map.pose(); }));
          })
      .def_property_readonly(
          "offset",
          [](const SharedMap& self) {
            return tuple_of(self.read([](const auto& map) { return map.offset(); }));
          })
      .def("state",
           [](const SharedMap& self) {
             return arrays_of(self.read([](const auto& map) { return map.state(); }));
           })
      .def(py::pickle(
          [](const SharedMap& self) {
            ExperienceMapConfig config;
            MapState state = self.read([&](const ExperienceMap& map) {
              config = map.config();
              return map.state();
            });
            return py::make_tuple(config, arrays_of(std::move(state)));
          },
          [](const py::object& state) {
            constexpr const char* name = "an experience map";
            ExperienceMap map(part_of_state<ExperienceMapConfig>(state, 0, 2, name));
            map.restore(state_of(part_of_state<py::dict>(state, 1, 2, name)));
            return std::make_unique<SharedMap>(std::move(map));
          }));
}

}  // namespace

void bind_ratslam_experience_map(py::module_& module) {
  using namespace py::literals;
  PYBIND11_NUMPY_DTYPE(MapLink, source, target, distance, heading, facing, duration, sd_m, sd_rad);
  py::native_enum<ActionKind>(module, "ActionKind", "enum.IntEnum",
                              "What happens to the map; the values are those of OpenRatSLAM.")
      .value("NONE", ActionKind::none)
      .value("CREATE_NODE", ActionKind::create_node)
      .value("CREATE_EDGE", ActionKind::create_edge)
      .finalize();
  bind_config<ExperienceMapConfig>(module, "ExperienceMapConfig", "How the map is corrected.")
      .def(py::init(
          [](const Options& options) { return with_options(ExperienceMapConfig{}, options); }));
  py::class_<SharedMap> bound(module, "ExperienceMap",
                              "Places and links; fusionslam.ratslam.ExperienceMap is for users. "
                              "Threads may share a map.");
  bound.def(py::init([](const ExperienceMapConfig& config) {
              return std::make_unique<SharedMap>(ExperienceMap(config));
            }),
            "config"_a);
  bind_changes(bound);
  bind_values(bound);
}

}  // namespace fusionslam::bindings
