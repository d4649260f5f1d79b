// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "common.hpp"
#include "configuration.hpp"

namespace fusionslam::bindings {
namespace {

using OptionalConfig = std::optional<M2dpConfig>;

M2dpConfig chosen(const OptionalConfig& config, const std::string& preset) {
  return config ? *config : m2dp_preset(preset);
}

ColorSpace color_space_of(const std::string& name) {
  return choice_from_name<ColorSpace>("color_space", name);
}

py::array_t<double> to_numpy_matrix(Signature&& signature) {
  return to_numpy(std::move(signature.values), {signature.rows, signature.columns});
}

void bind_m2dp(py::module_& module) {
  using namespace py::literals;
  module.def(
      "m2dp",
      [](const PointsArg& points, const std::string& preset, const OptionalConfig& config,
         int threads) {
        const M2dpConfig settings = chosen(config, preset);
        return to_numpy(without_gil([&] { return m2dp(points.view(), settings, threads); }));
      },
      "points"_a, py::kw_only(), "preset"_a = "robust", "config"_a = py::none(), "threads"_a = 1,
      R"(M2DP descriptor of a cloud (He, Wang, Zhang, IROS 2016).

Args:
    points: float32 (N, 3), metres, any frame; N >= 4.
    preset: "robust" (default), "upright" (robust about the vertical: z has to point up), "paper"
        (He's MATLAB) or "author" (Perdomo's C++).
    config: an M2dpConfig, used instead of the preset.
    threads: threads of this call; 0 is one a core. The result does not depend on it.

Returns:
    float32 (192,): first left (64) and right (128) singular vectors of the signature matrix.

Raises:
    DataError: fewer than 4 points, NaN or infinity, points all equal or on one line.
    ShapeError, ConfigError: wrong array, unknown preset.)");
  module.def(
      "m2dp_signature",
      [](const PointsArg& points, const std::string& preset, const OptionalConfig& config,
         int threads) {
        const M2dpConfig settings = chosen(config, preset);
        return to_numpy_matrix(
            without_gil([&] { return m2dp_signature(points.view(), settings, threads); }));
      },
      "points"_a, py::kw_only(), "preset"_a = "robust", "config"_a = py::none(), "threads"_a = 1,
      R"(Signature matrix of M2DP: float64 (64, 128), one row a projection plane, counts / n.

Arguments and errors as m2dp.)");
}

void bind_cm2dp(py::module_& module) {
  using namespace py::literals;
  module.def(
      "cm2dp",
      [](const PointsArg& points, const ColorsArg& colors, const std::string& color_space,
         const std::string& preset, const OptionalConfig& config, int threads) {
        const M2dpConfig settings = chosen(config, preset);
        const ColorSpace space = color_space_of(color_space);
        return to_numpy(without_gil(
            [&] { return cm2dp(points.view(), colors.view(), space, settings, threads); }));
      },
      "points"_a, "colors"_a, py::kw_only(), "color_space"_a = "rgb", "preset"_a = "robust",
      "config"_a = py::none(), "threads"_a = 1,
      R"(c-M2DP descriptor of a coloured cloud (Perdomo 2019, chapter 3).

Args:
    points: float32 (N, 3), metres, any frame; N >= 4.
    colors: uint8 (N, 3), RGB.
    color_space: "rgb" (the published choice), "hsv" or "lab".
    preset, config, threads: as m2dp.

Returns:
    float32 (576,): first left (64) and right (512) singular vectors of the signature matrix.

Raises:
    DataError, ShapeError, ConfigError: as m2dp, and if there is not one colour a point.)");
  module.def(
      "cm2dp_signature",
      [](const PointsArg& points, const ColorsArg& colors, const std::string& color_space,
         const std::string& preset, const OptionalConfig& config, int threads) {
        const M2dpConfig settings = chosen(config, preset);
        const ColorSpace space = color_space_of(color_space);
        return to_numpy_matrix(without_gil([&] {
          return cm2dp_signature(points.view(), colors.view(), space, settings, threads);
        }));
      },
      "points"_a, "colors"_a, py::kw_only(), "color_space"_a = "rgb", "preset"_a = "robust",
      "config"_a = py::none(), "threads"_a = 1,
      R"(Signature matrix of c-M2DP: float64 (64, 512), counts / n: 128 shape bins, then
8 rings x 16 bins for each colour channel. Arguments and errors as cm2dp.)");
}

ScanContextConfig with_height(ScanContextConfig config, std::optional<double> height) {
  config.height = height.value_or(config.height);
  return config;
}

void bind_scan_context(py::module_& module) {
  using namespace py::literals;
  module.def(
      "scan_context",
      [](const PointsArg& points, std::optional<double> height, const ScanContextConfig& config) {
        const ScanContextConfig settings = with_height(config, height);
        return to_numpy(without_gil([&] { return scan_context(points.view(), settings); }));
      },
      "points"_a, py::kw_only(), "height"_a = py::none(), "config"_a = ScanContextConfig(),
      R"(Scan Context of a cloud (Kim, Kim, IROS 2018).

Of 60 sectors of azimuth, from x towards y, and 20 rings up to 80 m the height of the highest point
above the ground, 0 where there is none. compare_scan_contexts compares two, at every turn.

Args:
    points: float32 (N, 3), metres, in a frame whose z axis points up.
    height: of the frame's origin above the ground, metres; None is that of config, 2.
    config: a ScanContextConfig.

Returns:
    float32 (1200,): sector after sector, from the innermost ring outwards.

Raises:
    DataError: NaN or infinity, or no point above the ground within range.
    ShapeError, ConfigError: wrong array, value out of range.)");
  module.def(
      "cscan_context",
      [](const PointsArg& points, const ColorsArg& colors, std::optional<double> height,
         const ScanContextConfig& config) {
        const ScanContextConfig settings = with_height(config, height);
        return to_numpy(
            without_gil([&] { return cscan_context(points.view(), colors.view(), settings); }));
      },
      "points"_a, "colors"_a, py::kw_only(), "height"_a = py::none(),
      "config"_a = ScanContextConfig(),
      R"(Scan Context of a coloured cloud: heights, and beside them the hue of each bin.

Of each sector, first the heights of its rings, divided by the root mean square of all filled bins;
then the mean CIELab a of the points above the ground in each ring; then b. Colours are scaled to a
grey world, against exposure and tint; a and b are multiplied by 2 / (chroma + 5), so that hue
counts more than saturation, and colours about as much as heights.

Args:
    points, height, config: as scan_context.
    colors: uint8 (N, 3), RGB.

Returns:
    float32 (3600,): sector after sector; compare_scan_contexts compares two.

Raises:
    DataError, ShapeError, ConfigError: as scan_context, and if there is not one colour a point.)");
}

void bind_bev_spectrum(py::module_& module) {
  using namespace py::literals;
  module.def(
      "bev_spectrum",
      [](const PointsArg& points, std::optional<double> height, const BevSpectrumConfig& config) {
        BevSpectrumConfig settings = config;
        settings.height = height.value_or(settings.height);
        return to_numpy(without_gil([&] { return bev_spectrum(points.view(), settings); }));
      },
      "points"_a, py::kw_only(), "height"_a = py::none(), "config"_a = BevSpectrumConfig(),
      R"(Amplitude spectrum of a cloud seen from above, over direction.

A move of the sensor changes an amplitude spectrum little, and a turn shifts it over direction
(Reddy and Chatterji 1996). What rises above the ground is drawn in three layers by height. Of each
image, blurred, the descriptor holds log(1 + amplitude) at 24 frequencies in each of 60 directions
of half a turn, less the frequency's mean, each direction scaled to length 1.
compare_scan_contexts compares two at every turn; its yaw is then twice that of the clouds, which
may also be half a turn more.

Args:
    points: float32 (N, 3), metres, in a frame whose z axis points up.
    height: of the frame's origin above the ground, metres; None is that of config, 2.
    config: a BevSpectrumConfig.

Returns:
    float32 (4320,): direction after direction, of each the layers from the lowest upwards.

Raises:
    DataError: NaN or infinity, or no point above the ground within range.
    ShapeError, ConfigError: wrong array, value out of range.)");
  module.def(
      "fit_bev_spectrum",
      [](const PointsArg& points) {
        return without_gil([&] { return fit_bev_spectrum(points.view()); });
      },
      "points"_a,
      R"(Return the parameters of bev_spectrum that suit clouds like this one.

Args:
    points: float32 (N, 3), metres, in a frame whose z axis points up.

Returns:
    A BevSpectrumConfig: cells so wide that 99 % of what the cloud shows, seen from above, is within
    range, of 0.125 to 2 m in steps of the root of 2; height by the lowest points, of which a quarter
    is lower, and a tenth of a cell more.

Raises:
    DataError: NaN or infinity, or no points.
    ShapeError: wrong array.)");
}

void bind_shot(py::module_& module) {
  using namespace py::literals;
  module.def(
      "shot",
      [](const PointsArg& points, std::optional<double> normal_radius, int threads) {
        return to_numpy(without_gil([&] { return shot(points.view(), normal_radius, threads); }));
      },
      "points"_a, py::kw_only(), "normal_radius"_a = py::none(), "threads"_a = 1,
      R"(Global SHOT: PCL's SHOT at the centroid, the whole cloud its support
(Tombari, Salti, Di Stefano 2010; Perdomo 2019, section 4.1).

Args:
    points: float32 (N, 3), metres.
    normal_radius: metres; None is 5 x cloud_resolution(points).
    threads: threads of this call; the result does not depend on it.

Returns:
    float32 (352,).

Raises:
    DataError: NaN or infinity, equal points, or fewer than 5 points with a normal.)");
  module.def(
      "cshot",
      [](const PointsArg& points, const ColorsArg& colors, std::optional<double> normal_radius,
         int threads) {
        return to_numpy(without_gil(
            [&] { return cshot(points.view(), colors.view(), normal_radius, threads); }));
      },
      "points"_a, "colors"_a, py::kw_only(), "normal_radius"_a = py::none(), "threads"_a = 1,
      R"(Global CSHOT: SHOT with colour (Tombari, Salti, Di Stefano 2011; Perdomo 2019, 4.1).

Args:
    colors: uint8 (N, 3), RGB; the rest as shot.

Returns:
    float32 (1344,).)");
  module.def(
      "cloud_resolution",
      [](const PointsArg& points) {
        return without_gil([&] { return cloud_resolution(points.view()); });
      },
      "points"_a, "Mean distance from a point to its nearest neighbour, metres.");
  module.def(
      "estimate_normals",
      [](const PointsArg& points, double radius, int threads)
          -> py::typing::Tuple<py::array_t<float>, py::array_t<float>, py::array_t<std::int64_t>> {
        Normals normals =
            without_gil([&] { return estimate_normals(points.view(), radius, threads); });
        return py::make_tuple(rows_of_three(std::move(normals.normals)),
                              to_numpy(std::move(normals.curvatures)),
                              to_numpy(std::move(normals.indices)));
      },
      "points"_a, py::kw_only(), "radius"_a, "threads"_a = 1,
      R"(Least-squares normals (PCL), turned towards the origin.

Args:
    points: float32 (N, 3), metres.
    radius: of the neighbourhood, metres.

Returns:
    (normals float32 (M, 3), curvatures float32 (M,), indices int64 (M,)) of the points with at
    least three neighbours.)");
}

}  // namespace

void bind_shot_at_centroid(py::module_& module) {
  using namespace py::literals;
  module.def(
      "shot_at_centroid",
      [](const PointsArg& points, const PointsArg& normals, const std::optional<ColorsArg>& colors,
         int threads) {
        const ColorsView view = colors ? colors->view() : ColorsView{};
        return to_numpy(without_gil(
            [&] { return shot_at_centroid(points.view(), normals.view(), view, threads); }));
      },
      "points"_a, "normals"_a, "colors"_a = py::none(), py::kw_only(), "threads"_a = 1,
      R"(Global SHOT, or with colours CSHOT, of points whose normals are known.

Args:
    points: float32 (N, 3), metres; N >= 5.
    normals: float32 (N, 3), unit length.
    colors: uint8 (N, 3), RGB, or None.
    threads: threads of this call; 0 is one a core. The result does not depend on it.

Returns:
    float32 (352,) without colours, (1344,) with them.

Raises:
    DataError: NaN or infinity, or no local reference frame.
    ShapeError: not one normal and one colour a point.)");
}

void bind_singular_vectors(py::module_& module) {
  using namespace py::literals;
  module.def(
      "first_singular_vectors",
      [](const DescriptorTableArg& matrix) {
        const auto rows = static_cast<int>(matrix.array.shape(0));
        const auto columns = static_cast<int>(matrix.array.shape(1));
        return to_numpy(
            without_gil([&] { return first_singular_vectors(matrix.values(), rows, columns); }));
      },
      "matrix"_a,
      R"(First left and right singular vectors of a matrix of entries >= 0, both >= 0.

What m2dp and cm2dp make of a signature: iterated with a test of convergence; where the two
largest singular values are close, eigenvectors of A A^T in double precision.

Args:
    matrix: float32 (R, C).

Returns:
    float32 (R + C,): left, then right, each of length 1.

Raises:
    DataError: negative, infinite or NaN entries, or all zero.
    ShapeError: wrong array.)");
}

void bind_descriptors(py::module_& module) {
  bind_config<M2dpConfig>(module, "M2dpConfig", "Parameters of M2DP and c-M2DP.")
      .def(py::init([](const std::string& preset, const Options& options) {
             return with_options(m2dp_preset(preset), options);
           }),
           py::kw_only(), py::arg("preset") = "robust",
           "The preset's values, with the given options in their place.");
  bind_config<ScanContextConfig>(module, "ScanContextConfig", "Parameters of Scan Context.")
      .def(py::init(
          [](const Options& options) { return with_options(ScanContextConfig{}, options); }));
  bind_config<BevSpectrumConfig>(module, "BevSpectrumConfig", "Parameters of bev_spectrum.")
      .def(py::init(
          [](const Options& options) { return with_options(BevSpectrumConfig{}, options); }));
  bind_m2dp(module);
  bind_scan_context(module);
  bind_bev_spectrum(module);
  bind_cm2dp(module);
  bind_singular_vectors(module);
  bind_shot_at_centroid(module);
  bind_shot(module);
}

}  // namespace fusionslam::bindings
