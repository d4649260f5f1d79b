// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Preparation of images before points are projected into them.
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "../detail/opencv.hpp"
#include "fusionslam/fusion.hpp"
#include "projection.hpp"

namespace fusionslam {
namespace {

using Matrix = std::array<double, 9>;

void check_sizes(ImageView image, const CameraCalibration& calibration) {
  detail::check_image(image);
  if (image.width != calibration.width || image.height != calibration.height)
    throw ShapeError("the image is " + detail::size_text(image.width, image.height) +
                     ", its calibration is for " +
                     detail::size_text(calibration.width, calibration.height));
  detail::check_size_for_opencv(image);
}

void check_finite(const auto& values, const std::string& name) {
  if (!std::all_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); }))
    throw DataError(name + " is not finite");
}

void check_focal_lengths(double x, double y, const std::string& name) {
  if (!(x > 0 && y > 0))
    throw DataError(name + " has focal lengths " + std::to_string(x) + " and " + std::to_string(y) +
                    ", expected more than 0 (a camera without calibration?)");
}

void check_camera_matrix(const Matrix& k) {
  check_finite(k, "the camera matrix");
  check_focal_lengths(k[0], k[4], "the camera matrix");
  if (k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1)
    throw DataError("the camera matrix is not of the form fx 0 cx, 0 fy cy, 0 0 1");
}

void check_rotation(const Matrix& values) {
  check_finite(values, "the rectification");
  const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> r(values.data());
  constexpr double digits = 1e-3;  // as calibrations are written down
  if (!(r * r.transpose()).isIdentity(digits) || r.determinant() < 0)
    throw DataError("the rectification is no rotation");
}

void check_distortion(const CameraCalibration& calibration) {
  check_finite(calibration.distortion, "the distortion");
  const std::size_t count = calibration.distortion.size();
  const auto expect = [&](bool fine, const char* expected) {
    if (fine) return;
    throw DataError("the distortion has " + detail::count_text(count, "coefficient") + ", " +
                    std::string(choice_name(calibration.model)) + " has " + expected);
  };
  switch (calibration.model) {
    case DistortionModel::none:
      return expect(count == 0, "none");
    case DistortionModel::plumb_bob:
      return expect(count == 0 || count == 4 || count == 5, "4 or 5");
    case DistortionModel::rational_polynomial:
      return expect(count == 0 || count == 8, "8");
    case DistortionModel::equidistant:
      return expect(count == 4, "4");
  }
}

void check_calibration(const CameraCalibration& calibration) {
  check_camera_matrix(calibration.camera_matrix);
  check_rotation(calibration.rectification);
  check_distortion(calibration);
  detail::check_projection(calibration.projection);
  check_focal_lengths(calibration.projection[0], calibration.projection[5],
                      "the projection matrix");
}

/// Column and row in the image as taken of each pixel of the rectified image.
struct PixelMaps {
  cv::Mat columns, rows;
};

PixelMaps pixel_maps(const CameraCalibration& calibration) {
  const cv::Mat camera(calibration.camera_matrix, true);
  const cv::Mat rectification(calibration.rectification, true);
  const cv::Matx34d projection(calibration.projection.data());
  const cv::Matx33d wanted = projection.get_minor<3, 3>(0, 0);
  const cv::Mat distortion(calibration.distortion, true);
  const cv::Size size(calibration.width, calibration.height);
  PixelMaps maps;
  if (calibration.model == DistortionModel::equidistant)
    cv::fisheye::initUndistortRectifyMap(camera.reshape(1, 3), distortion,
                                         rectification.reshape(1, 3), wanted, size, CV_32FC1,
                                         maps.columns, maps.rows);
  else
    cv::initUndistortRectifyMap(camera.reshape(1, 3), distortion, rectification.reshape(1, 3),
                                wanted, size, CV_32FC1, maps.columns, maps.rows);
  return maps;
}

Image blank_image(int width, int height, int channels) {
  const auto size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
                    static_cast<std::size_t>(channels);
  return {std::vector<std::uint8_t>(size), width, height, channels};
}

/// A view that OpenCV may write to; it has the right size and type, so nothing is allocated.
cv::Mat as_matrix(Image& image) {
  return {image.height, image.width, CV_8UC(image.channels), image.pixels.data()};
}

int color_code(BayerPattern pattern) {
  // OpenCV names mosaics by the second row's second and third pixel.
  switch (pattern) {
    case BayerPattern::rggb:
      return cv::COLOR_BayerBG2RGB;
    case BayerPattern::bggr:
      return cv::COLOR_BayerRG2RGB;
    case BayerPattern::gbrg:
      return cv::COLOR_BayerGR2RGB;
    case BayerPattern::grbg:
      return cv::COLOR_BayerGB2RGB;
  }
  throw ConfigError("unknown Bayer pattern");
}

}  // namespace

Image rectify_image(ImageView image, const CameraCalibration& calibration) {
  check_sizes(image, calibration);
  check_calibration(calibration);
  Image rectified = blank_image(image.width, image.height, image.channels);
  detail::with_opencv([&] {
    const PixelMaps maps = pixel_maps(calibration);
    cv::Mat pixels = as_matrix(rectified);
    cv::remap(detail::image_matrix(image), pixels, maps.columns, maps.rows, cv::INTER_LINEAR,
              cv::BORDER_CONSTANT, cv::Scalar());
  });
  return rectified;
}

Image demosaic(ImageView mosaic, BayerPattern pattern) {
  detail::check_image(mosaic);
  if (mosaic.channels != 1)
    throw ShapeError("the mosaic has " + std::to_string(mosaic.channels) +
                     " channels, expected 1 (grey)");
  if (std::min(mosaic.width, mosaic.height) < 4)
    throw DataError("a mosaic of " + detail::size_text(mosaic.width, mosaic.height) +
                    ", expected at least 4 pixels a side");
  detail::check_size_for_opencv(mosaic);
  Image colored = blank_image(mosaic.width, mosaic.height, 3);
  detail::with_opencv([&] {
    cv::Mat pixels = as_matrix(colored);
    cv::demosaicing(detail::image_matrix(mosaic), pixels, color_code(pattern));
  });
  return colored;
}

}  // namespace fusionslam
