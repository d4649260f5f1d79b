// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Descriptors of scans whose z axis points up and whose origin is the scanner.
#include "common.hpp"
#include "configuration.hpp"

namespace fusionslam::bindings {
namespace {

using namespace py::literals;

template <class Config>
void bind_options(py::module_& module, const char* name, const char* doc) {
  bind_config<Config>(module, name, doc).def(py::init([](const Options& options) {
    return with_options(Config{}, options);
  }));
}

/// A descriptor of points alone: name(points, *, config).
template <class Config>
void bind_shape(py::module_& module, const char* name,
                std::vector<float> (*compute)(PointsView, const Config&), const char* doc) {
  module.def(
      name,
      [compute](const PointsArg& points, const Config& config) {
        return to_numpy(without_gil([&] { return compute(points.view(), config); }));
      },
      "points"_a, py::kw_only(), "config"_a = Config(), doc);
}

void bind_scan_context_plus(py::module_& module) {
  bind_options<ScanContextPolarConfig>(module, "ScanContextPolarConfig",
                                       "Parameters of scan_context_polar.");
  bind_shape<ScanContextPolarConfig>(module, "scan_context_polar", scan_context_polar,
                                     R"(Polar Context of Scan Context++ (Kim, Choi, Kim, T-RO 2022).

The heights of scan_context with 20 rings; what is new is how two are compared, with
metric="aligned_polar". A turn about z by a sector of 6 degrees moves the sectors by one.

Args:
    points: float32 (N, 3), metres, in a frame whose z axis points up.
    config: a ScanContextPolarConfig.

Returns:
    float32 (1200,): 60 sectors from x towards y, each with 20 rings outwards.

Raises:
    DataError: NaN or infinity, or no point above the ground within range.
    ShapeError, ConfigError: wrong array, value out of range.)");
  bind_options<ScanContextCartesianConfig>(module, "ScanContextCartesianConfig",
                                           "Parameters of scan_context_cartesian.");
  bind_shape<ScanContextCartesianConfig>(
      module, "scan_context_cartesian", scan_context_cartesian,
      R"(Cartesian Context of Scan Context++ (Kim, Choi, Kim, T-RO 2022).

The height above the ground of the highest point of each of 40 x 40 cells, 0 without one. A move to
the side by the width of a column, 2 m, moves the columns by one; half a turn about z reverses the
values. Compared with metric="aligned_cartesian".

Args:
    points: float32 (N, 3), metres, in a frame whose x axis points ahead and whose z axis points up.
    config: a ScanContextCartesianConfig.

Returns:
    float32 (1600,): 40 columns along y from -40 to 40 m, each with 40 cells along x from -100 to
    100 m.

Raises:
    DataError: NaN or infinity, or no point above the ground within range.
    ShapeError, ConfigError: wrong array, value out of range.)");
}

void bind_solid(py::module_& module) {
  bind_options<SolidConfig>(module, "SolidConfig", "Parameters of solid.");
  bind_shape<SolidConfig>(
      module, "solid", solid,
      R"(SOLiD of a cloud: its part over range (Kim, Choi, Sim, Kim, Cho, RA-L 2024).

The mean points of voxels are counted over range and elevation; a bin of elevation weighs its count,
scaled to [0, 1]. Of length 1, so that L2 orders as the paper's cosine does. Turns about z change it
only as far as points fall into other voxels.

Args:
    points: float32 (N, 3), metres, in a frame whose z axis points up and whose origin is the
        scanner.
    config: a SolidConfig.

Returns:
    float32 (40,): bins of horizontal range, outwards.

Raises:
    DataError: NaN or infinity, or no point within range and elevations.
    ShapeError, ConfigError: wrong array, value out of range.)");
  module.def(
      "solid_parts",
      [](const PointsArg& points,
         const SolidConfig& config) -> py::typing::Tuple<py::array_t<float>, py::array_t<float>> {
        SolidParts parts = without_gil([&] { return solid_parts(points.view(), config); });
        return py::make_tuple(to_numpy(std::move(parts.ranges)),
                              to_numpy(std::move(parts.azimuths)));
      },
      "points"_a, py::kw_only(), "config"_a = SolidConfig(),
      R"(Both parts of SOLiD; arguments and errors as solid.

Returns:
    (R-SOLiD, float32 (40,), by horizontal range; A-SOLiD, float32 (60,), by azimuth, from x towards
    y).)");
  module.def(
      "compare_solid_azimuths",
      [](const DescriptorArg& query,
         const DescriptorArg& match) -> py::typing::Tuple<py::float_, py::float_> {
        const TurnedMatch found =
            without_gil([&] { return compare_solid_azimuths(query.values(), match.values()); });
        return py::make_tuple(found.distance, found.yaw);
      },
      "query"_a, "match"_a,
      R"(The turn between two clouds, from the azimuths of solid_parts.

Args:
    query, match: float32 (60,).

Returns:
    (distance, yaw): the least sum of absolute differences over all shifts by 6 degrees, and the
    turn of the query's frame in the match's, radians, above -pi to pi.

Raises:
    ShapeError, DataError: wrong array, NaN or infinity.)");
}

void bind_intensity_scan_context(py::module_& module) {
  bind_options<IntensityScanContextConfig>(module, "IntensityScanContextConfig",
                                           "Parameters of intensity_scan_context.");
  module.def(
      "intensity_scan_context",
      [](const PointsArg& points, const IntensitiesArg& intensities,
         const IntensityScanContextConfig& config) {
        return to_numpy(without_gil(
            [&] { return intensity_scan_context(points.view(), intensities.values(), config); }));
      },
      "points"_a, "intensities"_a, py::kw_only(), "config"_a = IntensityScanContextConfig(),
      R"(Intensity Scan Context of a cloud (Wang, Wang, Xie, ICRA 2020).

The largest intensity in each bin, divided by the largest within range: 0 in bins without points, at
least 1 / 255 in others. A turn about z by a sector of 6 degrees moves the sectors by one. Compared
with metric="intensity_scan_context".

Args:
    points: float32 (N, 3), metres, in a frame whose z axis points up.
    intensities: float32 (N,), finite and >= 0, in any unit.
    config: an IntensityScanContextConfig.

Returns:
    float32 (1200,): 60 sectors from x towards y, each with 20 rings outwards to 60 m.

Raises:
    DataError: NaN or infinity, a negative intensity, or no intensity > 0 within range.
    ShapeError, ConfigError: wrong array, not one intensity a point, value out of range.)");
}

void bind_iris(py::module_& module) {
  bind_options<IrisConfig>(module, "IrisConfig", "Parameters of iris.");
  module.def(
      "iris_image",
      [](const PointsArg& points, const IrisConfig& config) {
        return to_numpy(without_gil([&] { return iris_image(points.view(), config); }), {80, 360});
      },
      "points"_a, py::kw_only(), "config"_a = IrisConfig(),
      R"(LiDAR-Iris image of a cloud; arguments and errors as iris.

Returns:
    uint8 (80, 360), rings outwards to 80 m and columns of a degree from x towards y: bit i is set
    where there is a point in slice i, upwards, of the 8 from z = -3 to 5 m.)");
  bind_shape<IrisConfig>(module, "iris", iris,
                         R"(LiDAR Iris of a cloud (Wang, Sun, Xu, Sarma, Yang, Kong, IROS 2020).

Signs of the real and imaginary responses of four LoG-Gabor filters along the rings of iris_image. A
turn about z by a degree moves the columns by one. Compared with metric="iris".

Args:
    points: float32 (N, 3), metres, in a frame whose z axis points up and whose origin is the
        scanner.
    config: an IrisConfig.

Returns:
    float32 (28800,), whole numbers from 0 to 65535: of each of 360 columns 40 words of code, then
    40 of mask. Bit 8 (ring % 2) + 2 filter + part (0 real, 1 imaginary) of word ring / 2 is set in
    the code if the response is > 0, in the mask if it is strong enough to count.

Raises:
    DataError: NaN or infinity, or no point within range and slices.
    ShapeError, ConfigError: wrong array, value out of range.)");
}

void bind_ring(py::module_& module) {
  bind_options<RingConfig>(module, "RingConfig", "Parameters of ring.");
  bind_shape<RingConfig>(
      module, "ring", ring,
      R"(RING of a cloud (Lu, Xu, Yin, Chen, Xiong, Wang, IROS 2022): a spectrum of its sinogram.

What rises above the ground is drawn from above, in 120 x 120 cells, and summed along lines at 120
angles of half a turn; the amplitudes of the sums' frequencies do not change as the sensor moves,
but for what enters and leaves the image and how it falls into cells. A turn about z by 1.5 degrees
moves the angles around by one; half a turn changes nothing. Compared with metric="ring".

Args:
    points: float32 (N, 3), metres, in a frame whose z axis points up.
    config: a RingConfig.

Returns:
    float32 (7200,): 120 angles from x towards y, each with the frequencies 1 to 60.

Raises:
    DataError: NaN or infinity, or no point above the ground within range.
    ShapeError, ConfigError: wrong array, value out of range.)");
}

void bind_ndt_histogram(py::module_& module) {
  bind_options<NdtHistogramConfig>(module, "NdtHistogramConfig", "Parameters of ndt_histogram.");
  bind_shape<NdtHistogramConfig>(
      module, "ndt_histogram", ndt_histogram,
      R"(Surface-shape histograms of a cloud (Magnusson, Andreasson, Nuechter, Lilienthal, ICRA 2009).

Cells of points are counted as lines, planes of 9 directions or round, in 5 shells of distance. The
set of up to four histograms, each of the cloud turned so that a common direction of walls lies
along x, does not change as the cloud is turned about z. Compared with metric="nearest_of_set".

Args:
    points: float32 (N, 3), metres, in a frame whose z axis points up and whose origin is the
        scanner.
    config: an NdtHistogramConfig.

Returns:
    float32 (220,): four histograms of 5 shells x 11 classes with the sum 1, unused ones 0.

Raises:
    DataError: NaN or infinity, or no cell with 5 points.
    ShapeError, ConfigError: wrong array, value out of range.)");
}

}  // namespace

void bind_descriptors_scans(py::module_& module) {
  bind_scan_context_plus(module);
  bind_solid(module);
  bind_intensity_scan_context(module);
  bind_iris(module);
  bind_ring(module);
  bind_ndt_histogram(module);
}

}  // namespace fusionslam::bindings
