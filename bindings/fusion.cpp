// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "common.hpp"
#include "configuration.hpp"

namespace fusionslam::bindings {
namespace {

/// (points, colors, indices)
CloudTuple to_tuple(ColoredCloud&& cloud) {
  return py::make_tuple(rows_of_three(std::move(cloud.points)),
                        rows_of_three(std::move(cloud.colors)), to_numpy(std::move(cloud.indices)));
}

/// (points, colors, indices, cameras, gains)
using AllRoundTuple =
    py::typing::Tuple<py::array_t<float>, py::array_t<std::uint8_t>, py::array_t<std::int64_t>,
                      py::array_t<std::uint8_t>, py::array_t<double>>;

py::array_t<std::uint8_t> to_array(Image&& image) {
  std::vector<py::ssize_t> shape{image.height, image.width};
  if (image.channels == 3) shape.push_back(3);
  return to_numpy(std::move(image.pixels), std::move(shape));
}

void bind_images(py::module_& module) {
  using namespace py::literals;
  module.def(
      "rectify_image",
      [](const ImageArg& image, const CameraMatrixArg& camera_matrix,
         const DistortionArg& distortion, const std::string& model,
         const RectificationArg& rectification, const ProjectionArg& projection,
         const std::pair<int, int>& size) {
        const CameraCalibration calibration{
            size.first,
            size.second,
            camera_matrix.values,
            distortion.values,
            choice_from_name<DistortionModel>("distortion model", model.empty() ? "none" : model),
            rectification.values,
            projection.values};
        return to_array(without_gil([&] { return rectify_image(image.view(), calibration); }));
      },
      "image"_a, py::kw_only(), "camera_matrix"_a, "distortion"_a, "model"_a, "rectification"_a,
      "projection"_a, "size"_a,
      R"(The image as a pinhole camera would have taken it (sensor_msgs/CameraInfo), by OpenCV.

Args:
    image: uint8 (H, W, 3) RGB or (H, W), as taken.
    camera_matrix: float64 (3, 3), K.
    distortion: float64 (K,): 4 or 5 for plumb_bob, 8 for rational_polynomial (both also 0, for
        no distortion), 4 for equidistant, 0 for none.
    model: "plumb_bob", "rational_polynomial", "equidistant", "none" or "".
    rectification: float64 (3, 3), R, rectified_from_camera.
    projection: float64 (3, 4), P of the rectified image.
    size: (width, height) that the calibration is for.

Returns:
    uint8, of the image's shape, read bilinearly; black where the camera did not see.

Raises:
    DataError: matrices that are no camera's (zeros, NaN), another number of coefficients.
    ShapeError: an image of another size. ConfigError: unknown model.)");
  module.def(
      "demosaic",
      [](const ImageArg& image, const std::string& pattern) {
        const auto mosaic = choice_from_name<BayerPattern>("pattern", pattern);
        return to_array(without_gil([&] { return demosaic(image.view(), mosaic); }));
      },
      "image"_a, "pattern"_a,
      R"(The RGB image behind a Bayer mosaic: means of the nearest pixels, by OpenCV.

Args:
    image: uint8 (H, W), at least 4 pixels a side.
    pattern: colours of the upper left 2 x 2 pixels, row by row: "rggb", "bggr", "gbrg", "grbg".

Returns:
    uint8 (H, W, 3), RGB; the outermost pixels are copies of their inner neighbours.

Raises:
    ShapeError: an image with three channels. DataError: too small. ConfigError: unknown pattern.)");
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
      "colorize_all_round",
      [](const PointsArg& points, const std::vector<ImageArg>& images,
         const std::vector<ProjectionArg>& projections, bool balance,
         const std::string& interpolation) -> AllRoundTuple {
        const auto method = choice_from_name<Interpolation>("interpolation", interpolation);
        if (images.size() != projections.size())
          throw ShapeError(std::to_string(images.size()) + " images and " +
                           std::to_string(projections.size()) +
                           " projections, expected one of each camera");
        std::vector<CameraView> cameras;
        for (std::size_t k = 0; k < images.size(); ++k)
          cameras.push_back({images[k].view(), projections[k].values});
        AllRoundCloud found = without_gil(
            [&] { return colorize_all_round(points.view(), cameras, balance, method); });
        std::vector<double> gains;
        for (const auto& channels : found.gains)
          gains.insert(gains.end(), channels.begin(), channels.end());
        ColoredCloud& cloud = found.cloud;
        return py::make_tuple(rows_of_three(std::move(cloud.points)),
                              rows_of_three(std::move(cloud.colors)),
                              to_numpy(std::move(cloud.indices)),
                              to_numpy(std::move(found.cameras)), rows_of_three(std::move(gains)));
      },
      "points"_a, "images"_a, "projections"_a, py::kw_only(), "balance"_a = true,
      "interpolation"_a = "nearest",
      R"(Colours points with the pixels of several cameras, each as colorize does.

A point that several cameras see takes the colour of the one to whose image's centre it is
nearest, across in half widths of the image and down in half heights.

Args:
    points: float32 (N, 3), metres.
    images: of each of 1 to 255 cameras: uint8 (H, W, 3) RGB or (H, W).
    projections: of each camera: float64 (3, 4), maps homogeneous points to pixels.
    balance: multiply red, green and blue of each camera by gains that give cameras the same
        median colour where two of them see the same points, at least 30; by least squares of the
        gains' logarithms, whose mean is 0 over linked cameras. Gains are limited to 1/2 and 2;
        cameras that share no points keep 1.
    interpolation: "nearest" or "bilinear".

Returns:
    (points float32 (M, 3), colors uint8 (M, 3), indices int64 (M,), cameras uint8 (M,): the
    number of the camera of each, gains float64 (K, 3)) of the points that some camera sees.

Raises:
    DataError: as colorize, or no camera. ShapeError: not as many images as projections.)");
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
  bind_config<GroundSegmentsConfig>(module, "GroundSegmentsConfig",
                                    "Parameters of the ground fitted segment by segment.")
      .def(py::init(
          [](const Options& options) { return with_options(GroundSegmentsConfig{}, options); }));
  module.def(
      "remove_ground_segments",
      [](const PointsArg& points, const std::string& up, const GroundSegmentsConfig& config)
          -> py::typing::Tuple<py::array_t<std::int64_t>, py::array_t<double>,
                               py::array_t<double>> {
        const UpAxis axis = choice_from_name<UpAxis>("up", up);
        GroundSegments ground =
            without_gil([&] { return remove_ground_segments(points.view(), axis, config); });
        std::vector<double> planes;
        for (const auto& plane : ground.planes)
          planes.insert(planes.end(), plane.begin(), plane.end());
        return py::make_tuple(to_numpy(std::move(ground.kept)),
                              to_numpy(std::move(planes), {config.segments, 4}),
                              to_numpy(std::move(ground.borders)));
      },
      "points"_a, py::kw_only(), "up"_a = "z", "config"_a = GroundSegmentsConfig{},
      R"(Fits the ground from the lowest points up, segment by segment along the driving axis
(Zermas, Izzat, Papanikolopoulos, ICRA 2017), and drops what is not above it.

A segment without a ground of its own (few points, a wall, a step) takes its neighbour's plane.

Args:
    points: float32 (N, 3), metres.
    up: x, y, z, -x, -y or -z.

Returns:
    (indices kept int64 (M,), planes float64 (S, 4): a x + b y + c z + d = 0 with the normal up,
    borders float64 (S + 1,) of the segments along the driving axis). Planes are zeros, and every
    point is kept, where no segment shows any ground.

Raises:
    ConfigError: the driving axis points up. DataError: NaN or infinity in a point.)");
  module.def(
      "voxel_downsample",
      [](const PointsArg& points, const std::optional<ColorsArg>& colors, double size) {
        const ColorsView view = colors ? colors->view() : ColorsView{};
        return to_tuple(without_gil([&] { return voxel_downsample(points.view(), view, size); }));
      },
      "points"_a, "colors"_a = py::none(), py::kw_only(), "size"_a,
      R"(One point for each cube of size metres: mean position and colour.

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

/// float64 (K, 4, 4).
std::vector<Transform> transforms_from(const py::array& given) {
  if (given.ndim() != 3 || given.shape(1) != 4 || given.shape(2) != 4)
    throw ShapeError("poses has shape " + shape_text(given) + ", expected (K, 4, 4)");
  const auto array = contiguous<double>(given);
  std::vector<Transform> poses(static_cast<std::size_t>(array.shape(0)));
  for (std::size_t k = 0; k < poses.size(); ++k)
    std::copy_n(array.data() + 16 * k, 16, poses[k].begin());
  return poses;
}

void bind_motion(py::module_& module) {
  using namespace py::literals;
  module.def(
      "deskew",
      [](const PointsArg& points, const NumbersArg& seconds, const NumbersArg& poses,
         const std::pair<double, double>& span) {
        const ScanPath path{span.first, span.second, transforms_from(poses.array)};
        return rows_of_three(
            without_gil([&] { return deskew(points.view(), seconds.values(), path); }));
      },
      "points"_a, "seconds"_a, "poses"_a, "span"_a,
      R"(Undoes the motion within a scan: the points as the scanner would have seen them at its stamp.

Between two poses positions and rotation matrices are interpolated linearly, so steps in which the
scanner turns by an angle a leave an error of a^2/8 of the range.

Args:
    points: float32 (N, 3), metres, each in the scanner's frame when it was measured. NaN and
        infinity mark rays without return, and stay.
    seconds: float64 (N,), when each point was measured, after the stamp.
    poses: float64 (K, 4, 4), stamp_from_then: where the scanner was at even steps of time, in its
        own frame at the stamp.
    span: seconds from the stamp to the first and to the last pose; points outside move with these.

Returns:
    float32 (N, 3), metres, in the scanner's frame at the stamp.

Raises:
    ShapeError: arrays of other shapes.
    DataError: no pose, a pose or a time that is not finite, or a span that falls.)");
}

}  // namespace

void bind_fusion(py::module_& module) {
  bind_images(module);
  bind_projection(module);
  bind_stereo(module);
  bind_filters(module);
  bind_motion(module);
}

}  // namespace fusionslam::bindings
