// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Disparity by OpenCV and coloured clouds from it (Perdomo 2019, 3.3.2).
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "../detail/opencv.hpp"
#include "fusionslam/fusion.hpp"
#include "projection.hpp"

namespace fusionslam {
namespace {

constexpr double disparity_scale = 16;  // OpenCV's fixed-point disparities

void check_pair(ImageView left, ImageView right) {
  detail::check_image(left);
  detail::check_image(right);
  if (left.width != right.width || left.height != right.height)
    throw ShapeError("the left image is " + detail::size_text(left.width, left.height) +
                     ", the right " + detail::size_text(right.width, right.height));
  detail::check_size_for_opencv(left);
}

void check_config(const StereoConfig& config, ImageView left) {
  validate(config);
  const auto expect = [](bool fine, const std::string& message) {
    if (!fine) throw ConfigError("stereo." + message);
  };
  expect(config.num_disparities % 16 == 0, "num_disparities is " +
                                               std::to_string(config.num_disparities) +
                                               ", expected a multiple of 16");
  expect(
      config.block_size % 2 == 1 && (config.method == StereoMethod::sgbm || config.block_size >= 5),
      "block_size is " + std::to_string(config.block_size) + ", expected odd, for bm at least 5");
  expect(config.block_size < std::min(left.width, left.height),
         "block_size is " + std::to_string(config.block_size) + ", larger than the image");
  expect(config.pre_filter_size % 2 == 1,
         "pre_filter_size is " + std::to_string(config.pre_filter_size) + ", expected odd");
  expect(config.method == StereoMethod::bm || config.p1 < config.p2, "p1 must be below p2");
  expect(config.min_range < config.max_range, "min_range must be below max_range");
}

cv::Ptr<cv::StereoMatcher> block_matcher(const StereoConfig& config) {
  auto matcher = cv::StereoBM::create(config.num_disparities, config.block_size);
  matcher->setPreFilterType(cv::StereoBM::PREFILTER_XSOBEL);
  matcher->setPreFilterSize(config.pre_filter_size);
  matcher->setPreFilterCap(config.pre_filter_cap);
  matcher->setTextureThreshold(config.texture_threshold);
  matcher->setUniquenessRatio(config.uniqueness_ratio);
  return matcher;
}

cv::Ptr<cv::StereoMatcher> semi_global_matcher(const StereoConfig& config) {
  return cv::StereoSGBM::create(config.min_disparity, config.num_disparities, config.block_size,
                                config.p1, config.p2, config.disp12_max_diff, config.pre_filter_cap,
                                config.uniqueness_ratio);
}

cv::Mat match(const cv::Mat& left, const cv::Mat& right, const StereoConfig& config) {
  const auto matcher =
      config.method == StereoMethod::bm ? block_matcher(config) : semi_global_matcher(config);
  matcher->setMinDisparity(config.min_disparity);
  matcher->setSpeckleRange(config.speckle_range);
  matcher->setSpeckleWindowSize(config.speckle_window_size);
  // OpenCV writes nothing into parts of images that are narrower than the disparities.
  cv::Mat disparity(left.size(), CV_16S, cv::Scalar((config.min_disparity - 1) * disparity_scale));
  matcher->compute(left, right, disparity);
  if (config.median_blur) cv::medianBlur(disparity, disparity, 5);
  return disparity;
}

/// A rectified pair in the form that triangulation needs.
struct Triangulation {
  double focal_x, focal_y, center_x, center_y, left_x, left_y, left_w, right_w;
  double center_shift;  ///< between the two principal points, in pixels
  double baseline;      ///< times the focal length

  /// Point in the rectified frame; z <= 0 or infinite where the disparity allows none.
  std::array<double, 3> point(double u, double v, double disparity) const {
    const double z =
        (baseline - u * left_w + (u - disparity) * right_w) / (disparity - center_shift);
    const double w = z + left_w;
    return {(u * w - center_x * z - left_x) / focal_x, (v * w - center_y * z - left_y) / focal_y,
            z};
  }
};

/// Rows and focal lengths agree, the images are not skewed and look the same way.
bool is_rectified_pair(const Projection& left, const Projection& right) {
  const auto near = [](double a, double b) {
    return std::fabs(a - b) <= 1e-6 * (1 + std::fabs(a));
  };
  const auto straight = [](const Projection& p) {
    return p[1] == 0 && p[4] == 0 && p[8] == 0 && p[9] == 0 && p[10] == 1;
  };
  return straight(left) && straight(right) && near(left[0], right[0]) && near(left[5], right[5]) &&
         near(left[6], right[6]);
}

Triangulation triangulation_of(const StereoCalibration& calibration) {
  const Projection& l = calibration.left;
  const Projection& r = calibration.right;
  detail::check_projection(l);
  detail::check_projection(r);
  if (!is_rectified_pair(l, r))
    throw DataError("the two projections do not belong to a rectified stereo pair");
  if (!(l[3] - r[3] > 0))
    throw DataError("the stereo pair has no baseline, or left and right are exchanged");
  return {l[0], l[5], l[2], l[6], l[3], l[7], l[11], r[11], l[2] - r[2], l[3] - r[3]};
}

std::array<float, 3> transformed(const Transform& t, const std::array<double, 3>& p) {
  std::array<float, 3> result{};
  for (std::size_t i = 0; i < 3; ++i)
    result[i] = static_cast<float>(t[4 * i] * p[0] + t[4 * i + 1] * p[1] + t[4 * i + 2] * p[2] +
                                   t[4 * i + 3]);
  return result;
}

void append(ColoredCloud& cloud, const std::array<float, 3>& point, ImageView image, int row,
            int column) {
  const std::uint8_t* pixel = image.pixel(row, column);
  const int step = image.channels == 3 ? 1 : 0;
  cloud.points.insert(cloud.points.end(), point.begin(), point.end());
  cloud.colors.insert(cloud.colors.end(), {pixel[0], pixel[step], pixel[2 * step]});
  cloud.indices.push_back(static_cast<std::int64_t>(row) * image.width + column);
}

}  // namespace

StereoConfig stereo_preset(std::string_view name) {
  StereoConfig config;
  if (name == "image_undistort") return config;
  if (name != "sgbm")
    throw ConfigError("stereo preset is '" + std::string(name) +
                      "', expected one of image_undistort, sgbm");
  config.method = StereoMethod::sgbm;
  config.block_size = 5;
  config.p1 = 8 * 5 * 5;
  config.p2 = 32 * 5 * 5;
  config.uniqueness_ratio = 10;
  config.disp12_max_diff = 1;
  config.speckle_window_size = 100;
  config.speckle_range = 2;
  return config;
}

std::vector<float> stereo_disparity(ImageView left, ImageView right, const StereoConfig& config) {
  check_pair(left, right);
  check_config(config, left);
  const cv::Mat fixed = detail::with_opencv(
      [&] { return match(detail::grey_image(left), detail::grey_image(right), config); });
  const double lowest = config.min_disparity * disparity_scale;
  std::vector<float> disparity;
  disparity.reserve(fixed.total());
  for (int row = 0; row < fixed.rows; ++row)
    for (int column = 0; column < fixed.cols; ++column) {
      const double value = fixed.at<std::int16_t>(row, column);
      disparity.push_back(value >= lowest ? static_cast<float>(value / disparity_scale) : 0.0F);
    }
  return disparity;
}

ColoredCloud cloud_from_disparity(const std::vector<float>& disparity, ImageView left_colors,
                                  const StereoCalibration& calibration,
                                  const StereoConfig& config) {
  detail::check_image(left_colors);
  validate(config);
  const auto width = static_cast<std::size_t>(left_colors.width);
  if (disparity.size() != width * static_cast<std::size_t>(left_colors.height))
    throw ShapeError("the disparity has " + std::to_string(disparity.size()) +
                     " pixels, the image is " + std::to_string(left_colors.width) + "x" +
                     std::to_string(left_colors.height));
  const Triangulation triangulation = triangulation_of(calibration);
  ColoredCloud cloud;
  for (int row = 0; row < left_colors.height; ++row)
    for (int column = 0; column < left_colors.width; ++column) {
      const float here =
          disparity[static_cast<std::size_t>(row) * width + static_cast<std::size_t>(column)];
      if (here == 0) continue;
      if (!std::isfinite(here))
        throw DataError("the disparity of row " + std::to_string(row) + ", column " +
                        std::to_string(column) + " is not finite");
      const auto point = triangulation.point(column, row, here);
      if (!(point[2] >= config.min_range && point[2] <= config.max_range)) continue;
      append(cloud, transformed(calibration.cloud_from_rectified, point), left_colors, row, column);
    }
  return cloud;
}

}  // namespace fusionslam
