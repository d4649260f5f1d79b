// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Descriptors that are histograms of a whole cloud, of its regions or about its keypoints.
#include "common.hpp"
#include "configuration.hpp"

namespace fusionslam::bindings {
namespace {

template <class Config>
void bind_options(py::module_& module, const char* name, const char* doc) {
  bind_config<Config>(module, name, doc).def(py::init([](const Options& options) {
    return with_options(Config{}, options);
  }));
}

void bind_region_histograms(py::module_& module) {
  using namespace py::literals;
  module.def(
      "vfh",
      [](const PointsArg& points, const VfhConfig& config, int threads) {
        return to_numpy(without_gil([&] { return vfh(points.view(), config, threads); }));
      },
      "points"_a, py::kw_only(), "config"_a = VfhConfig(), "threads"_a = 1,
      R"(Viewpoint Feature Histogram (Rusu, Bradski, Thibaux, Hsu, IROS 2010), binned as in PCL.

Args:
    points: float32 (N, 3), metres, the sensor at the origin.
    config: a VfhConfig.
    threads: threads of this call; 0 is one a core. The result does not depend on it.

Returns:
    float32 (308,), no entry negative: 45 bins each of theta, alpha, phi and distance between the
    centroid, with the mean normal, and the points, then 128 of the angle between normals and the
    direction to the origin; each histogram sums to about 100.

Raises:
    DataError: NaN or infinity, or fewer than 3 points with a normal.
    ShapeError, ConfigError: wrong array, value out of range.)");
  module.def(
      "cvfh",
      [](const PointsArg& points, const CvfhConfig& config, int threads) {
        return to_numpy(without_gil([&] { return cvfh(points.view(), config, threads); }));
      },
      "points"_a, py::kw_only(), "config"_a = CvfhConfig(), "threads"_a = 1,
      R"(Clustered Viewpoint Feature Histogram (Aldoma et al., ICCV Workshops 2011).

Args:
    points: float32 (N, 3), metres, the sensor at the origin.
    config: a CvfhConfig.
    threads: threads of this call; 0 is one a core. The result does not depend on it.

Returns:
    float32 (regions * 308,): the VFH of the whole cloud about the centroid and normal of each
    smooth region, the largest region first; blocks without a region are zero.

Raises:
    DataError: NaN or infinity, fewer than 3 points with a normal, no smooth region.
    ShapeError, ConfigError: wrong array, value out of range.)");
  module.def(
      "our_cvfh",
      [](const PointsArg& points, const OurCvfhConfig& config, int threads) {
        return to_numpy(without_gil([&] { return our_cvfh(points.view(), config, threads); }));
      },
      "points"_a, py::kw_only(), "config"_a = OurCvfhConfig(), "threads"_a = 1,
      R"(OUR-CVFH (Aldoma, Tombari, Rusu, Vincze, DAGM 2012).

Args:
    points: float32 (N, 3), metres, the sensor at the origin.
    config: an OurCvfhConfig.
    threads: threads of this call; 0 is one a core. The result does not depend on it.

Returns:
    float32 (regions * 308,): for each frame of reference of each smooth region, the largest region
    first, 135 angle bins as in cvfh, 8 x 13 distance bins in octants, 69 viewpoint bins; blocks
    without a region are zero.

Raises:
    DataError, ShapeError, ConfigError: as cvfh.)");
}

void bind_cloud_histograms(py::module_& module) {
  using namespace py::literals;
  module.def(
      "esf",
      [](const PointsArg& points) {
        return to_numpy(without_gil([&] { return esf(points.view()); }));
      },
      "points"_a,
      R"(Ensemble of Shape Functions (Wohlkinger, Vincze, ROBIO 2011), with PCL's weights.

Twenty thousand triangles of points are drawn by a generator with a fixed seed: the same array has
the same ESF, the same points in another order one that differs by the error of sampling.

Args:
    points: float32 (N, 3), metres, any frame; N >= 3.

Returns:
    float32 (640,), sums to 1: 64 bins each of angles, square roots of areas, and lengths, for lines
    on the surface, off it and both; then of the share of the surface in lines that are both.

Raises:
    DataError: NaN or infinity, fewer than 3 points, points all equal or on one line.
    ShapeError: wrong array.)");
  module.def(
      "gestalt",
      [](const PointsArg& points, const GestaltConfig& config, int threads) {
        return to_numpy(without_gil([&] { return gestalt(points.view(), config, threads); }));
      },
      "points"_a, py::kw_only(), "config"_a = GestaltConfig(), "threads"_a = 1,
      R"(3D Gestalt descriptors at keypoints (Bosse, Zlot, ICRA 2013).

Args:
    points: float32 (N, 3), metres, in a frame whose z axis points up.
    config: a GestaltConfig.
    threads: threads of this call; 0 is one a core. The result does not depend on it.

Returns:
    float32 (keypoints * 66,): of each keypoint mean height (32, metres) and variance of the height
    (32, square metres) in 4 rings x 8 sectors about it, then its x and y (metres); blocks without a
    keypoint are zero.

Raises:
    DataError: NaN or infinity, or a cloud without a keypoint.
    ShapeError, ConfigError: wrong array, value out of range.)");
  module.def(
      "gfh",
      [](const PointsArg& points, const GfhConfig& config) {
        return to_numpy(without_gil([&] { return gfh(points.view(), config); }));
      },
      "points"_a, py::kw_only(), "config"_a = GfhConfig(),
      R"(Global Fourier Histogram (Chen et al. 2014).

Args:
    points: float32 (N, 3), metres, in a frame whose z axis points up, the sensor on its z axis.
    config: a GfhConfig.

Returns:
    float32 (rings * layers * (sectors // 2 + 1),) of length 1: amplitudes of the Fourier transform,
    over azimuth, of the number of points in each ring and layer.

Raises:
    DataError: NaN or infinity, or no point in the cylinder.
    ShapeError, ConfigError: wrong array, value out of range.)");
}

void bind_color_histograms(py::module_& module) {
  using namespace py::literals;
  module.def(
      "gasd_color",
      [](const PointsArg& points, const ColorsArg& colors) {
        return to_numpy(without_gil([&] { return gasd_color(points.view(), colors.view()); }));
      },
      "points"_a, "colors"_a,
      R"(GASD with colour (Lima, Teichrieb, SIBGRAPI 2016).

Args:
    points: float32 (N, 3), metres, any frame; N >= 4.
    colors: uint8 (N, 3), RGB.

Returns:
    float32 (984,): in the frame of the principal axes, percent of the points in 6 x 6 x 6 cells,
    then in 12 bins of hue in each of 4 x 4 x 4 cells.

Raises:
    DataError: fewer than 4 points, NaN or infinity, points all equal or on one line.
    ShapeError: wrong array, or not one colour a point.)");
  module.def(
      "cospair",
      [](const PointsArg& points, const ColorsArg& colors, const CospairConfig& config,
         int threads) {
        return to_numpy(
            without_gil([&] { return cospair(points.view(), colors.view(), config, threads); }));
      },
      "points"_a, "colors"_a, py::kw_only(), "config"_a = CospairConfig(), "threads"_a = 1,
      R"(CoSPAIR at the centroid (after Logoglu, Kalkan, Temizel, Robotics and Autonomous Systems 2016).

Args:
    points: float32 (N, 3), metres, the sensor at the origin.
    colors: uint8 (N, 3), RGB.
    config: a CospairConfig.
    threads: threads of this call; 0 is one a core. The result does not depend on it.

Returns:
    float32 (378,): for each of 7 shells about the centroid, 9 bins each of theta, alpha, phi
    between the mean normal and the points' and of CIELab L, a, b; each histogram sums to 1.

Raises:
    DataError: NaN or infinity, or fewer than 3 points with a normal.
    ShapeError, ConfigError: wrong array, value out of range, or not one colour a point.)");
}

}  // namespace

void bind_descriptor_histograms(py::module_& module) {
  bind_options<VfhConfig>(module, "VfhConfig", "Parameters of vfh.");
  bind_options<CvfhConfig>(module, "CvfhConfig", "Parameters of cvfh.");
  bind_options<OurCvfhConfig>(module, "OurCvfhConfig", "Parameters of our_cvfh.");
  bind_options<GestaltConfig>(module, "GestaltConfig", "Parameters of gestalt.");
  bind_options<GfhConfig>(module, "GfhConfig", "Parameters of gfh.");
  bind_options<CospairConfig>(module, "CospairConfig", "Parameters of cospair.");
  bind_region_histograms(module);
  bind_cloud_histograms(module);
  bind_color_histograms(module);
}

}  // namespace fusionslam::bindings
