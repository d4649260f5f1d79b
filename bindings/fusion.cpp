// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "common.hpp"

namespace fusionslam::bindings {
namespace {

/// (points, colors, indices)
CloudTuple to_tuple(ColoredCloud&& cloud) {
  return py::make_tuple(rows_of_three(std::move(cloud.points)),
                        rows_of_three(std::move(cloud.colors)), to_numpy(std::move(cloud.indices)));
}

void bind_projection(py::module_& module) {
  using namespace py::literals;
  module.def(
      "colorize",
      [](const PointsArg& points, const ImageArg& image, const ProjectionArg& projection,
         const std::string& interpolation) {
        const auto method = choice_from_name<Interpolation>("interpolation", interpolation);
        return to_tuple(without_gil(
            [&] { return colorize(points.view(), image.view(), projection.values, method); }));
      },
      "points"_a, "image"_a, "projection"_a, py::kw_only(), "interpolation"_a = "nearest",
      R"(Colours points with the pixels they project to (Perdomo 2019, 3.3.1).

Args:
    points: float32 (N, 3), metres.
    image: uint8 (H, W, 3) RGB or (H, W).
    projection: float64 (3, 4), maps homogeneous points to pixels.
    interpolation: "nearest" or "bilinear".

Returns:
    (points float32 (M, 3), colors uint8 (M, 3), indices int64 (M,)) of the points in front of
    the camera whose nearest pixel lies inside the image.

Raises:
    DataError: singular projection, NaN or infinity in a point, empty image.)");
  module.def(
      "depth_image",
      [](const PointsArg& points, const ProjectionArg& projection, int width, int height) {
        return to_numpy(without_gil([&] {
                          return depth_image(points.view(), width, height, projection.values);
                        }),
                        {height, width});
      },
      "points"_a, "projection"_a, py::kw_only(), "width"_a, "height"_a,
      R"(Depth along the optical axis of the nearest point in each pixel: float32 (height, width),
metres, 0 where there is none. Arguments and errors as colorize.)");
}

void bind_stereo(py::module_& module) {
  using namespace py::literals;
  bind_config<StereoConfig>(module, "StereoConfig", "Parameters of stereo matching.")
      .def(py::init([](const std::string& preset, const Options& options) {
             return with_options(stereo_preset(preset), options);
           }),
           py::kw_only(), "preset"_a = "image_undistort",
           "The preset's values (image_undistort or sgbm), with the given options in their place.");
  module.def(
      "stereo_disparity",
      [](const ImageArg& left, const ImageArg& right, const StereoConfig& config) {
        const ImageView view = left.view();
        return to_numpy(without_gil([&] { return stereo_disparity(view, right.view(), config); }),
                        {view.height, view.width});
      },
      "left"_a, "right"_a, py::kw_only(), "config"_a = StereoConfig{},
      R"(Disparity of a rectified pair by OpenCV: float32 (H, W), pixels, 0 where there is none.

Args:
    left, right: uint8 (H, W) or (H, W, 3) RGB of the same size.

Raises:
    ShapeError: images of different size. ConfigError: sizes that OpenCV refuses.)");
  module.def(
      "cloud_from_disparity",
      [](const DisparityArg& disparity, const ImageArg& image, const ProjectionArg& left,
         const ProjectionArg& right, const std::optional<TransformArg>& cloud_from_rectified,
         const StereoConfig& config) {
        const ImageView view = image.view();
        const auto& pixels = disparity.array;
        if (pixels.shape(0) != view.height || pixels.shape(1) != view.width)
          throw ShapeError("disparity has shape " + shape_text(pixels) + ", the image is (" +
                           std::to_string(view.height) + ", " + std::to_string(view.width) + ")");
        StereoCalibration calibration{left.values, right.values, identity_transform};
        if (cloud_from_rectified) calibration.cloud_from_rectified = cloud_from_rectified->values;
        const std::vector<float> values(pixels.data(), pixels.data() + pixels.size());
        return to_tuple(
            without_gil([&] { return cloud_from_disparity(values, view, calibration, config); }));
      },
      "disparity"_a, "image"_a, "left_projection"_a, "right_projection"_a, py::kw_only(),
      "cloud_from_rectified"_a = py::none(), "config"_a = StereoConfig{},
      R"(Coloured cloud of a disparity image.

Args:
    disparity: float32 (H, W), pixels of the left image, 0 where there is none.
    image: the left colours, uint8 (H, W, 3) RGB or (H, W).
    left_projection, right_projection: float64 (3, 4) of the rectified pair.
    cloud_from_rectified: float64 (4, 4), the frame wanted; None is the rectified camera frame.

Returns:
    (points float32 (M, 3), colors uint8 (M, 3), indices int64 (M,): row-major pixels).

Raises:
    DataError: projections that are no rectified pair. ShapeError: sizes that differ.)");
}

void bind_filters(py::module_& module) {
  using namespace py::literals;
  bind_config<GroundPlaneConfig>(module, "GroundPlaneConfig", "Parameters of the ground plane.")
      .def(py::init(
          [](const Options& options) { return with_options(GroundPlaneConfig{}, options); }));
  module.def(
      "above_height",
      [](const PointsArg& points, double height, const std::string& up) {
        const UpAxis axis = choice_from_name<UpAxis>("up", up);
        return to_numpy(without_gil([&] { return above_height(points.view(), height, axis); }));
      },
      "points"_a, "height"_a, py::kw_only(), "up"_a = "z",
      "Indices, int64 (M,), of the points above height metres along up (x, y, z, -x, -y, -z).");
  module.def(
      "remove_ground_plane",
      [](const PointsArg& points, const std::string& up, const GroundPlaneConfig& config)
          -> py::typing::Tuple<py::array_t<std::int64_t>, py::array_t<double>> {
        const UpAxis axis = choice_from_name<UpAxis>("up", up);
        GroundPlane ground =
            without_gil([&] { return remove_ground_plane(points.view(), axis, config); });
        return py::make_tuple(
            to_numpy(std::move(ground.kept)),
            to_numpy(std::vector<double>(ground.coefficients.begin(), ground.coefficients.end())));
      },
      "points"_a, py::kw_only(), "up"_a = "z", "config"_a = GroundPlaneConfig{},
      R"(Finds the ground plane by RANSAC (PCL, seeded) and drops its points.

Returns:
    (indices kept int64 (M,), plane float64 (4,): a x + b y + c z + d = 0 with the normal up;
    zeros, and every point kept, where there is none).)");
  module.def(
      "voxel_downsample",
      [](const PointsArg& points, const std::optional<ColorsArg>& colors, double size) {
        const ColorsView view = colors ? colors->view() : ColorsView{};
        return to_tuple(without_gil([&] { return voxel_downsample(points.view(), view, size); }));
      },
      "points"_a, "colors"_a = py::none(), py::kw_only(), "size"_a,
      R"(One point a cube of size metres: mean position and colour.

Returns:
    (points float32 (M, 3), colors uint8 (M, 3), or (0, 3) without colours, indices int64 (M,):
    the first point of each cube).)");
  module.def(
      "drop_invalid",
      [](const PointsArg& points) {
        return to_numpy(without_gil([&] { return drop_invalid(points.view()); }));
      },
      "points"_a, "Indices, int64 (M,), of the points without NaN or infinity.");
}

}  // namespace

void bind_fusion(py::module_& module) {
  bind_projection(module);
  bind_stereo(module);
  bind_filters(module);
}

}  // namespace fusionslam::bindings
