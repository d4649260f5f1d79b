// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "configuration.hpp"

namespace fusionslam::bindings {
namespace {

using FitTuple = py::typing::Tuple<double, double, double, double>;

template <std::size_t Size>
py::array_t<double> square(const std::array<double, Size>& values, py::ssize_t side) {
  return to_numpy(std::vector<double>(values.begin(), values.end()), {side, side});
}

py::array_t<double> poses_of(const OdometryTree& tree) {
  std::vector<double> values;
  values.reserve(16 * static_cast<std::size_t>(tree.size()));
  for (std::int64_t node = 0; node < tree.size(); ++node)
    values.insert(values.end(), tree.pose(node).begin(), tree.pose(node).end());
  return to_numpy(std::move(values), {tree.size(), 4, 4});
}

py::array_t<std::int64_t> roots_of(const OdometryTree& tree) {
  std::vector<std::int64_t> roots;
  roots.reserve(static_cast<std::size_t>(tree.size()));
  for (std::int64_t node = 0; node < tree.size(); ++node) roots.push_back(tree.root(node));
  return to_numpy(std::move(roots));
}

using TreeState = py::typing::Tuple<py::array, py::array, py::array>;

template <class Row>
py::array rows_of(const OdometryTree& tree, const Row& (OdometryTree::*row)(std::int64_t) const) {
  std::vector<double> values;
  for (std::int64_t node = 0; node < tree.size(); ++node)
    values.insert(values.end(), (tree.*row)(node).begin(), (tree.*row)(node).end());
  return to_numpy(std::move(values),
                  {tree.size(), static_cast<py::ssize_t>(std::tuple_size_v<Row>)});
}

template <class Row>
std::vector<Row> rows_from(const py::array& given) {
  constexpr auto width = static_cast<py::ssize_t>(std::tuple_size_v<Row>);
  if (given.ndim() != 2 || given.shape(1) != width || !is_float(given))
    throw DataError("state of an odometry tree: an array of shape " + shape_text(given) +
                    ", expected (n, " + std::to_string(width) + ")");
  const auto array = contiguous<double>(given);
  std::vector<Row> rows(static_cast<std::size_t>(array.shape(0)));
  for (std::size_t i = 0; i < rows.size(); ++i)
    std::copy_n(array.data() + static_cast<py::ssize_t>(i) * width, width, rows[i].begin());
  return rows;
}

TreeState state_of_tree(const OdometryTree& tree) {
  std::vector<std::int64_t> parents;
  for (std::int64_t node = 0; node < tree.size(); ++node) parents.push_back(tree.parent(node));
  return py::make_tuple(rows_of(tree, &OdometryTree::pose), rows_of(tree, &OdometryTree::total),
                        to_numpy(std::move(parents)));
}

OdometryTree tree_of_state(const py::object& state) {
  constexpr const char* name = "an odometry tree";
  const auto given = part_of_state<py::array>(state, 2, 3, name);
  if (given.ndim() != 1 || given.dtype().kind() != 'i')
    throw DataError("state of an odometry tree: parents are no whole numbers");
  const auto parents = contiguous<std::int64_t>(given);
  OdometryTree tree;
  tree.restore(rows_from<Pose3>(part_of_state<py::array>(state, 0, 3, name)),
               rows_from<PoseCovariance>(part_of_state<py::array>(state, 1, 3, name)),
               {parents.data(), parents.data() + parents.size()});
  return tree;
}

}  // namespace

void bind_mapping(py::module_& module) {
  using namespace py::literals;
  bind_config<DriftConfig>(module, "DriftConfig", "How the error of odometry grows with motion.")
      .def(py::init([](const Options& options) { return with_options(DriftConfig{}, options); }));
  module.def(
      "drift_covariance",
      [](const DriftConfig& config, const TransformArg& motion) {
        return square(drift_covariance(config, motion.values), 6);
      },
      "config"_a, "motion"_a,
      R"(Covariance of odometry's error over a motion.

Args:
    config: how the error grows.
    motion: float64 (4, 4), rigid: from where the robot was to where it is.

Returns:
    float64 (6, 6), as that of an ``Edge``.)");
  py::class_<OdometryTree>(module, "OdometryTree",
                           "Poses of nodes by odometry alone, and the drift between any two that "
                           "it connects.")
      .def(py::init<>())
      .def(
          "add_root",
          [](OdometryTree& self, const TransformArg& pose) { return self.add_root(pose.values); },
          "pose"_a, "Adds a node at which odometry begins; returns its number.")
      .def(
          "add",
          [](OdometryTree& self, std::int64_t parent, const TransformArg& step,
             const CovarianceArg& covariance, bool backwards) {
            return self.add(parent, step.values, covariance.values, backwards);
          },
          "parent"_a, "step"_a, "covariance"_a, py::kw_only(), "backwards"_a = false,
          "Adds the node at the other end of a step parent_from_node (backwards: "
          "node_from_parent); returns its number.")
      .def(
          "drift",
          [](const OdometryTree& self, std::int64_t a, std::int64_t b) {
            return square(self.drift(a, b), 6);
          },
          "a"_a, "b"_a, "float64 (6, 6), covariance of the error of a_from_b by odometry.")
      .def(
          "fit",
          [](const OdometryTree& self, std::int64_t a, std::int64_t b,
             const std::array<double, 6>& error, const CovarianceArg& covariance,
             double sigmas) -> FitTuple {
            const DriftFit fit = self.fit(a, b, error, covariance.values, sigmas);
            return py::make_tuple(fit.error_m, fit.error_rad, fit.allowed_m, fit.allowed_rad);
          },
          "a"_a, "b"_a, "error"_a, "covariance"_a, "sigmas"_a,
          "Compares a measured pose a_from_b with odometry: the values of DriftFit. The error is "
          "the small motion from where the measurement has b to where odometry has it.")
      .def(
          "pose",
          [](const OdometryTree& self, std::int64_t node) { return square(self.pose(node), 4); },
          "node"_a, "float64 (4, 4), of a node.")
      .def("parent", &OdometryTree::parent, "node"_a, "The node before; of a root, itself.")
      .def("root", &OdometryTree::root, "node"_a, "The node at which its odometry begins.")
      .def("__len__", &OdometryTree::size)
      .def_property_readonly("poses", &poses_of, "float64 (n, 4, 4), of all nodes.")
      .def_property_readonly("roots", &roots_of, "int64 (n), of all nodes.")
      .def(py::pickle(&state_of_tree, &tree_of_state));
}

}  // namespace fusionslam::bindings
