// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

enum class Interpolation { nearest, bilinear };

template <>
struct ChoiceNames<Interpolation> {
  static constexpr std::array<std::string_view, 2> value{"nearest", "bilinear"};
};

/// Colours each point with the pixel it projects to (Perdomo 2019, 3.3.1; Stastny 2022, 4.3).
///
/// Keeps the points in front of the camera whose projection, rounded to the nearest pixel, lies
/// inside the image. Grey images give equal channels. Throws DataError if the projection is not
/// finite or singular, a point is not finite, or the image is empty.
ColoredCloud colorize(PointsView points, ImageView image, const Projection& projection,
                      Interpolation interpolation = Interpolation::nearest);

/// An image of one of several cameras, and the projection that maps the scan's points to its
/// pixels.
struct CameraView {
  ImageView image;
  Projection projection{};
};

/// A scan coloured by several cameras.
struct AllRoundCloud {
  ColoredCloud cloud;
  std::vector<std::uint8_t> cameras;         ///< number of the camera that coloured each point
  std::vector<std::array<double, 3>> gains;  ///< of red, green and blue, by camera
};

/// Colours each point that at least one camera sees (as colorize says), in the order of the scan.
///
/// A point that several cameras see takes the colour of the one to whose image's centre it is
/// nearest, with the distance across measured in half widths of the image and that down in half
/// heights, so that images of different sizes compare; of equally near ones the first.
///
/// `balance` multiplies each camera's colours by a gain of each channel, since exposure and white
/// balance of cameras differ: two cameras that see at least 30 points in common, neither dark nor
/// saturated, are given the same median colour of these points; over all pairs by least squares of
/// the gains' logarithms, weighted by the numbers of points (Brown, Lowe 2007, section 6, has the
/// gains themselves). The mean logarithm of cameras that are linked by such pairs is 0; cameras
/// without pairs keep gain 1. Gains are limited to 1/2 and 2.
///
/// Throws as colorize, and DataError for no camera or more than 255.
AllRoundCloud colorize_all_round(PointsView points, const std::vector<CameraView>& cameras,
                                 bool balance = true,
                                 Interpolation interpolation = Interpolation::nearest);

/// Depth along the optical axis of the nearest point in each pixel, row-major; 0 where there is
/// none. Throws as colorize.
std::vector<float> depth_image(PointsView points, int width, int height,
                               const Projection& projection);

/// An 8-bit image that owns its pixels: 1 channel (grey) or 3 (RGB), rows without padding.
struct Image {
  std::vector<std::uint8_t> pixels;
  int width = 0;
  int height = 0;
  int channels = 3;

  ImageView view() const {
    return {pixels.data(), width, height, channels, static_cast<std::size_t>(width * channels)};
  }
};

/// Lens distortion models of sensor_msgs/CameraInfo.
enum class DistortionModel { none, plumb_bob, rational_polynomial, equidistant };

template <>
struct ChoiceNames<DistortionModel> {
  static constexpr std::array<std::string_view, 4> value{"none", "plumb_bob", "rational_polynomial",
                                                         "equidistant"};
};

/// Calibration of a camera (sensor_msgs/CameraInfo); matrices are row-major.
struct CameraCalibration {
  int width = 0;  ///< of the image as taken, and of the rectified one
  int height = 0;
  std::array<double, 9> camera_matrix{};  ///< K of the image as taken, without skew
  std::vector<double> distortion;         ///< as many coefficients as the model has
  DistortionModel model = DistortionModel::none;
  std::array<double, 9> rectification{1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< rectified_from_camera
  Projection projection{};  ///< P of the rectified image; its last column plays no part
};

/// The image as a pinhole camera with the calibration's projection would have taken it, read
/// bilinearly; pixels that the camera did not see are black.
///
/// Coefficients: plumb_bob 4 or 5 (k1 k2 p1 p2 k3), rational_polynomial 8 (k1 k2 p1 p2 k3 to k6),
/// equidistant 4 (k1 to k4), none 0; plumb_bob and rational_polynomial also 0, for no distortion.
/// Throws DataError for invalid matrices (a focal length of 0, a rectification that is not a
/// rotation, NaN) or another number of coefficients, ShapeError if the size of the image is not the
/// calibration's.
Image rectify_image(ImageView image, const CameraCalibration& calibration);

/// The colours of the upper left 2 x 2 pixels of a sensor behind a Bayer mosaic, row by row.
enum class BayerPattern { rggb, bggr, gbrg, grbg };

template <>
struct ChoiceNames<BayerPattern> {
  static constexpr std::array<std::string_view, 4> value{"rggb", "bggr", "gbrg", "grbg"};
};

/// The RGB image behind a Bayer mosaic: missing colours are means of their nearest pixels, those of
/// the outermost pixels are copied from the next row or column. Throws ShapeError for an image that
/// is not grey, DataError for one with fewer than 4 pixels a side.
Image demosaic(ImageView mosaic, BayerPattern pattern);

enum class StereoMethod { bm, sgbm };

template <>
struct ChoiceNames<StereoMethod> {
  static constexpr std::array<std::string_view, 2> value{"bm", "sgbm"};
};

/// Stereo matching. The defaults are the "image_undistort" preset.
struct StereoConfig {
  static constexpr const char* section = "stereo";

  StereoMethod method = StereoMethod::bm;
  int min_disparity = 0;
  int num_disparities = 64;
  int block_size = 21;
  int pre_filter_size = 9;
  int pre_filter_cap = 31;
  int texture_threshold = 10;
  int uniqueness_ratio = 15;
  int speckle_range = 0;
  int speckle_window_size = 0;
  int p1 = 120;
  int p2 = 240;
  int disp12_max_diff = -1;
  bool median_blur = true;
  double min_range = 0.5;
  double max_range = 80.0;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("method", config.method, OptionInfo{"OpenCV's StereoBM or StereoSGBM"});
    visitor("min_disparity", config.min_disparity,
            OptionInfo{"smallest disparity searched", "px", -1024, 1024});
    visitor("num_disparities", config.num_disparities,
            OptionInfo{"how many disparities are searched, a multiple of 16", "px", 16, 1024});
    visitor("block_size", config.block_size, OptionInfo{"window size, odd", "px", 1, 255});
    visitor("pre_filter_size", config.pre_filter_size,
            OptionInfo{"prefilter window, odd (StereoBM)", "px", 5, 255});
    visitor("pre_filter_cap", config.pre_filter_cap,
            OptionInfo{"bound of prefiltered values", "", 1, 63});
    visitor("texture_threshold", config.texture_threshold,
            OptionInfo{"least texture of a window (StereoBM)", "", 0, 100000});
    visitor("uniqueness_ratio", config.uniqueness_ratio,
            OptionInfo{"margin by which the best match must win", "%", 0, 100});
    visitor("speckle_range", config.speckle_range,
            OptionInfo{"disparity change inside one speckle", "px", 0, 1024});
    visitor("speckle_window_size", config.speckle_window_size,
            OptionInfo{"largest speckle to remove; 0 is off", "px", 0, 1000000});
    visitor("p1", config.p1, OptionInfo{"smoothness penalty, small changes (SGBM)", "", 0, 100000});
    visitor("p2", config.p2, OptionInfo{"smoothness penalty, large changes (SGBM)", "", 0, 100000});
    visitor("disp12_max_diff", config.disp12_max_diff,
            OptionInfo{"left-right check (SGBM); -1 is off", "px", -1, 1024});
    visitor("median_blur", config.median_blur,
            OptionInfo{"5 x 5 median filter on the disparity image"});
    visitor("min_range", config.min_range, OptionInfo{"nearest point kept", "m", 0, 1e6});
    visitor("max_range", config.max_range, OptionInfo{"farthest point kept", "m", 0, 1e6});
  }
};

/// "image_undistort": StereoBM with the defaults of image_undistort's depth node, which Perdomo
/// 2019 used. "sgbm": StereoSGBM with the penalties OpenCV recommends for 5 x 5 windows, a
/// left-right check and a speckle filter. Throws ConfigError for any other name.
StereoConfig stereo_preset(std::string_view name);

/// Disparity of a rectified pair, row-major float pixels of the left image; 0 where there is no
/// match. Throws ShapeError if the images differ in size, ConfigError for sizes OpenCV refuses.
std::vector<float> stereo_disparity(ImageView left, ImageView right,
                                    const StereoConfig& config = {});

/// A calibrated rectified pair; the transform maps its frame to that of the wanted cloud.
struct StereoCalibration {
  Projection left{};
  Projection right{};
  Transform cloud_from_rectified = identity_transform;
};

/// Coloured cloud of all pixels with a disparity whose depth is within the configured range.
/// `indices` are row-major pixels of the left image. Throws DataError if the two projections do not
/// belong to a rectified pair with a baseline, ShapeError if sizes differ.
ColoredCloud cloud_from_disparity(const std::vector<float>& disparity, ImageView left_colors,
                                  const StereoCalibration& calibration,
                                  const StereoConfig& config = {});

enum class UpAxis { x, y, z, minus_x, minus_y, minus_z };

template <>
struct ChoiceNames<UpAxis> {
  static constexpr std::array<std::string_view, 6> value{"x", "y", "z", "-x", "-y", "-z"};
};

/// Parameters of the ground plane found by RANSAC.
struct GroundPlaneConfig {
  static constexpr const char* section = "ground";

  double distance = 0.2;
  double max_tilt = 15.0;
  int iterations = 200;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("distance", config.distance,
            OptionInfo{"points this near to the plane are ground", "m", 1e-6, 1e6});
    visitor("max_tilt", config.max_tilt,
            OptionInfo{"largest angle between the plane's normal and up", "deg", 0, 90});
    visitor("iterations", config.iterations, OptionInfo{"RANSAC iterations", "", 1, 1000000});
  }
};

/// Indices of the points above `height` metres along `up` (Stastny 2022, 4.3).
std::vector<std::int64_t> above_height(PointsView points, double height, UpAxis up = UpAxis::z);

/// A plane a x + b y + c z + d = 0 with its normal pointing up, and the points not on it.
struct GroundPlane {
  std::array<double, 4> coefficients{};
  std::vector<std::int64_t> kept;
};

/// Finds the ground with PCL's SACSegmentation (seeded, so repeatable). If there is no plane, all
/// points are kept and the coefficients are zero. Throws DataError for fewer than 3 points.
GroundPlane remove_ground_plane(PointsView points, UpAxis up = UpAxis::z,
                                const GroundPlaneConfig& config = {});

/// The axis along which a cloud is cut into segments, in either direction.
enum class DrivingAxis { x, y, z };

template <>
struct ChoiceNames<DrivingAxis> {
  static constexpr std::array<std::string_view, 3> value{"x", "y", "z"};
};

/// Parameters of the ground fitted segment by segment. Zermas et al. have the first five, with 3
/// iterations; the others limit the effect of reflections below the floor and of segments without
/// ground.
struct GroundSegmentsConfig {
  static constexpr const char* section = "segments";

  int segments = 3;
  int iterations = 5;
  int lowest = 20;
  double seed_height = 0.4;
  double distance = 0.2;
  double lowest_share = 0.01;
  double max_tilt = 15.0;
  double max_step = 0.5;
  DrivingAxis driving = DrivingAxis::x;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("segments", config.segments,
            OptionInfo{"segments of one length along the driving axis", "", 1, 1000});
    visitor("iterations", config.iterations,
            OptionInfo{"how often a plane is fitted to its ground points", "", 1, 1000});
    visitor(
        "lowest", config.lowest,
        OptionInfo{"lowest points of a segment, whose median height starts it", "", 3, 1000000});
    visitor("seed_height", config.seed_height,
            OptionInfo{"points this near to that height are the first ground", "m", 1e-6, 1e6});
    visitor("distance", config.distance,
            OptionInfo{"points below the plane or this little above are ground", "m", 1e-6, 1e6});
    visitor("lowest_share", config.lowest_share,
            OptionInfo{"more lowest points in dense segments: at least this share of theirs", "", 0,
                       1});
    visitor("max_tilt", config.max_tilt,
            OptionInfo{"largest angle between a plane's normal and up", "deg", 0, 89});
    visitor("max_step", config.max_step,
            OptionInfo{"largest step from a segment's plane to the next", "m", 0, 1e6});
    visitor("driving", config.driving, OptionInfo{"axis that the robot drives along"});
  }
};

/// One plane a segment, and the points above them.
struct GroundSegments {
  /// a x + b y + c z + d = 0 with the normal up; zeros where there is no ground.
  std::vector<std::array<double, 4>> planes;
  std::vector<double> borders;  ///< of the segments along the driving axis, planes.size() + 1
  std::vector<std::int64_t> kept;
};

/// Fits the ground segment by segment, starting from the lowest points (Zermas, Izzat,
/// Papanikolopoulos, ICRA 2017), and keeps the points above it.
///
/// A segment takes its neighbour's plane if it has fewer than `lowest` points, its lowest points
/// form no plane (a wall, a single line), or its plane leans or leaves a step; planes spread
/// from the segment with most ground points. Where no segment has a plane, the whole cloud is tried
/// as one; where that has none, all points are kept.
/// Throws ConfigError if the driving axis points up, DataError for points that are not finite.
GroundSegments remove_ground_segments(PointsView points, UpAxis up = UpAxis::z,
                                      const GroundSegmentsConfig& config = {});

/// One point a cube of `size` metres: mean position and colour of the points in it, in the order in
/// which the cubes are first met; `indices` is the first point of each. `colors` may be empty.
/// Throws ConfigError if size <= 0, DataError if the cloud spans more than 2^21 cubes along an
/// axis.
ColoredCloud voxel_downsample(PointsView points, ColorsView colors, double size);

/// Indices of the points without NaN or infinity.
std::vector<std::int64_t> drop_invalid(PointsView points);

/// The way of a scanner while it took a scan.
struct ScanPath {
  double first = 0;              ///< seconds from the scan's stamp to the first pose
  double last = 0;               ///< seconds from the scan's stamp to the last pose
  std::vector<Transform> poses;  ///< stamp_from_then, at even steps of time
};

/// Undoes the motion within a scan: the points as the scanner would have seen them at its stamp.
///
/// `seconds` has the time of each point after the stamp. Between two poses positions and rotation
/// matrices are interpolated linearly, so steps in which the scanner turns by an angle a leave an
/// error of a^2/8 of the range; points before the first and after the last pose move with these.
/// Points that are not finite stay so.
///
/// Throws ShapeError for another number of times than of points, DataError for no pose, a pose or a
/// time that is not finite, or a last pose before the first.
std::vector<float> deskew(PointsView points, std::span<const double> seconds, const ScanPath& path);

}  // namespace fusionslam
