// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <filesystem>
#include <string_view>

#include "common.hpp"
#include "shared_index.hpp"

namespace fusionslam::bindings {
namespace {

using SharedDescriptors = SharedIndex<DescriptorIndex>;
using MatchTuple = py::typing::Tuple<py::array_t<std::int64_t>, py::array_t<float>>;

ExclusionWindow window_of(py::ssize_t frames, double seconds) {
  if (frames < 0) throw ConfigError("window is " + std::to_string(frames) + ", expected >= 0");
  if (!(seconds >= 0 && seconds < 9e9))
    throw ConfigError("window_seconds is " + std::to_string(seconds) + ", expected >= 0");
  return {static_cast<std::size_t>(frames), std::llround(seconds * 1e9)};
}

Metric metric_of(const std::string& name) { return choice_from_name<Metric>("metric", name); }

std::size_t count_of(py::ssize_t k) {
  if (k < 1) throw ConfigError("k is " + std::to_string(k) + ", expected at least 1");
  return static_cast<std::size_t>(k);
}

MatchTuple to_tuple(const std::vector<Match>& matches) {
  std::vector<std::int64_t> indices;
  std::vector<float> distances;
  for (const auto& [index, distance] : matches) {
    indices.push_back(index);
    distances.push_back(distance);
  }
  return py::make_tuple(to_numpy(std::move(indices)), to_numpy(std::move(distances)));
}

MatchTuple to_tuple(MatchTable&& table) {
  const auto columns = static_cast<py::ssize_t>(table.k);
  const auto rows = static_cast<py::ssize_t>(table.indices.size()) / columns;
  return py::make_tuple(to_numpy(std::move(table.indices), {rows, columns}),
                        to_numpy(std::move(table.distances), {rows, columns}));
}

}  // namespace

void bind_matching(py::module_& module) {
  using namespace py::literals;
  py::class_<SharedDescriptors>(module, "DescriptorIndex",
                                R"(Exact, causal nearest neighbours over added descriptors.

A query is answered as if it were the next descriptor to be added, number len(index): candidates
are older by more than window frames and by more than window_seconds.
Distances are L2, or those of another of metric_names(). Equal ones go to the lowest index.
Threads may share an index; processes get copies (pickle).)")
      .def(py::init([](py::ssize_t dimension, py::ssize_t window, double window_seconds,
                       const std::string& metric) {
             if (dimension < 1)
               throw ConfigError("dimension is " + std::to_string(dimension) +
                                 ", expected at least 1");
             return std::make_unique<SharedDescriptors>(
                 DescriptorIndex(static_cast<std::size_t>(dimension),
                                 window_of(window, window_seconds), metric_of(metric)));
           }),
           "dimension"_a, py::kw_only(), "window"_a = 0, "window_seconds"_a = 0.0,
           "metric"_a = "l2")
      .def(
          "add",
          [](SharedDescriptors& self, const DescriptorArg& descriptor,
             std::optional<std::int64_t> stamp_ns) {
            const auto values = descriptor.values();
            return self.write([&](DescriptorIndex& index) { return index.add(values, stamp_ns); });
          },
          "descriptor"_a, py::kw_only(), "stamp_ns"_a = py::none(),
          "Adds a descriptor, float32 (D,), and returns its index. A window in seconds needs "
          "stamp_ns.")
      .def(
          "query",
          [](const SharedDescriptors& self, const DescriptorArg& descriptor, py::ssize_t k,
             std::optional<std::int64_t> stamp_ns) {
            const std::size_t count = count_of(k);
            const auto values = descriptor.values();
            return to_tuple(self.read([&](const DescriptorIndex& index) {
              return index.query(values, count, stamp_ns);
            }));
          },
          "descriptor"_a, py::kw_only(), "k"_a = 1, "stamp_ns"_a = py::none(),
          R"(The nearest candidates, nearest first.

Returns:
    (indices int64 (M,), distances float32 (M,)), M <= k.

Raises:
    ShapeError, DataError: wrong length, NaN.
    ConfigError: the window is in seconds and stamp_ns is missing.)")
      .def(
          "save",
          [](const SharedDescriptors& self, const std::filesystem::path& path) {
            self.read([&](const DescriptorIndex& index) { index.save(path.string()); });
          },
          "path"_a,
          R"(Writes one file, whole or not at all, through a symbolic link.

The file keeps its mode; a new one gets what the umask leaves.

Raises:
    DataError: it cannot be written (code "cannot-write", fields: the path).)")
      .def_static(
          "load",
          [](const std::filesystem::path& path) {
            return std::make_unique<SharedDescriptors>(
                without_gil([&] { return DescriptorIndex::load(path.string()); }));
          },
          "path"_a,
          "Reads an index. Raises DataError if the file is none, of another version, or truncated.")
      .def(py::pickle(
          [](const SharedDescriptors& self) {
            const auto bytes =
                self.read([](const DescriptorIndex& index) { return index.to_bytes(); });
            return py::bytes(reinterpret_cast<const char*>(bytes.data()), bytes.size());
          },
          [](const py::object& state) {
            if (!py::isinstance<py::bytes>(state))
              throw DataError("state of a descriptor index: expected bytes");
            const std::string_view text = py::reinterpret_borrow<py::bytes>(state);
            return std::make_unique<SharedDescriptors>(without_gil([&] {
              return DescriptorIndex::from_bytes(
                  {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
            }));
          }))
      .def(
          "descriptor",
          [](const SharedDescriptors& self, std::size_t i) {
            return to_numpy(self.read([&](const DescriptorIndex& index) {
              const auto values = index.descriptor(i);
              return std::vector<float>(values.begin(), values.end());
            }));
          },
          "index"_a, "A copy of one descriptor, float32 (D,).")
      .def("__len__",
           [](const SharedDescriptors& self) {
             return self.read([](const DescriptorIndex& index) { return index.size(); });
           })
      .def_property_readonly(
          "dimension",
          [](const SharedDescriptors& self) {
            return self.read([](const DescriptorIndex& index) { return index.dimension(); });
          })
      .def_property_readonly(
          "window",
          [](const SharedDescriptors& self) {
            return self.read([](const DescriptorIndex& index) { return index.window().frames; });
          })
      .def_property_readonly("window_seconds",
                             [](const SharedDescriptors& self) {
                               return self.read([](const DescriptorIndex& index) {
                                 return static_cast<double>(index.window().nanoseconds) * 1e-9;
                               });
                             })
      .def_property_readonly("metric", [](const SharedDescriptors& self) {
        return std::string(
            choice_name(self.read([](const DescriptorIndex& index) { return index.metric(); })));
      });
  module.def(
      "nearest",
      [](const DescriptorTableArg& queries, const DescriptorTableArg& descriptors, py::ssize_t k,
         int threads, const std::string& metric) {
        const auto dimension = descriptors.array.shape(1);
        if (queries.array.shape(1) != dimension)
          throw ShapeError("queries have " + std::to_string(queries.array.shape(1)) +
                           " columns, descriptors have " + std::to_string(dimension));
        const std::size_t count = count_of(k);
        const Metric chosen = metric_of(metric);
        return to_tuple(without_gil([&] {
          return nearest(queries.values(), descriptors.values(),
                         static_cast<std::size_t>(dimension), count, threads, chosen);
        }));
      },
      "queries"_a, "descriptors"_a, py::kw_only(), "k"_a = 1, "threads"_a = 0, "metric"_a = "l2",
      R"(The k nearest descriptors of each query, exactly; equal distances go to the lowest row.

Args:
    queries, descriptors: float32 (N, D) and (M, D).
    metric: one of metric_names().

Returns:
    (indices int64 (N, k), -1 where there is none; distances float32 (N, k), infinite there).

Raises:
    ShapeError, DataError: other lengths, NaN, values that have no meaning in the metric.
    ConfigError: unknown metric.)");
  module.def(
      "nearest_causal",
      [](const DescriptorTableArg& descriptors, py::ssize_t window, py::ssize_t k, int threads,
         const std::string& metric) {
        const std::size_t frames = window_of(window, 0).frames;
        const std::size_t count = count_of(k);
        const Metric chosen = metric_of(metric);
        return to_tuple(without_gil([&] {
          return nearest_causal(descriptors.values(),
                                static_cast<std::size_t>(descriptors.array.shape(1)), frames, count,
                                threads, chosen);
        }));
      },
      "descriptors"_a, py::kw_only(), "window"_a, "k"_a = 1, "threads"_a = 0, "metric"_a = "l2",
      R"(For each row i the k nearest rows j < i - window, as an online run would find them.

Args:
    descriptors: float32 (N, D).
    metric: as nearest.

Returns:
    (indices int64 (N, k), -1 where there is none; distances float32 (N, k), infinite there).)");
  module.def(
      "metric_names",
      [] {
        py::typing::Tuple<py::str, py::ellipsis> names =
            py::tuple(ChoiceNames<Metric>::value.size());
        for (std::size_t i = 0; i < names.size(); ++i)
          names[i] = py::str(ChoiceNames<Metric>::value[i]);
        return names;
      },
      "The metrics by which descriptors can be compared; documented in docs/stages/matching.md.");
  module.def(
      "compare_descriptors",
      [](const DescriptorArg& query, const DescriptorArg& match, const std::string& metric)
          -> py::typing::Tuple<py::float_, py::typing::Optional<py::float_>> {
        const Metric chosen = metric_of(metric);
        const DescriptorMatch found = without_gil(
            [&] { return compare_descriptors(query.values(), match.values(), chosen); });
        return py::make_tuple(found.distance, found.yaw);
      },
      "query"_a, "match"_a, "metric"_a,
      R"(How alike two descriptors are, as an index of the metric has it.

Args:
    query, match: float32 (D,).
    metric: one of metric_names().

Returns:
    (distance; yaw of the query's frame in the match's, radians, or None where the metric finds no
    turn).

Raises:
    ShapeError, DataError: other lengths, NaN, values that have no meaning in the metric.
    ConfigError: unknown metric.)");
  module.def(
      "compare_scan_contexts",
      [](const DescriptorArg& query,
         const DescriptorArg& match) -> py::typing::Tuple<py::float_, py::float_> {
        const TurnedMatch found =
            without_gil([&] { return compare_scan_contexts(query.values(), match.values()); });
        return py::make_tuple(found.distance, found.yaw);
      },
      "query"_a, "match"_a,
      R"(How alike two Scan Contexts are (Kim, Kim, IROS 2018), and the turn between them.

The distance is 1 - the sum over the sectors of their cosines, divided by the sectors that are
filled in the fuller one, at the turn where that is least. The paper divides by the sectors that
are filled in both, which is the same for scans of the full circle; of narrow ones it takes any two
slivers for one place.

Args:
    query, match: float32 (60 R,), of scan_context or cscan_context, or of bev_spectrum, for which
        the yaw returned is twice that of the clouds.

Returns:
    (distance, 0 to 1; yaw of the query's frame in the match's, radians).

Raises:
    ShapeError, DataError: other lengths, NaN.)");
}

}  // namespace fusionslam::bindings
