// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <cmath>
#include <random>

#include "fusionslam/fusion.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;

constexpr int width = 64;
constexpr int height = 48;

/// A grey ramp, 2 a column and 1 a row, whose bilinear values are those of the formula.
std::vector<std::uint8_t> ramp() {
  std::vector<std::uint8_t> pixels;
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) pixels.push_back(static_cast<std::uint8_t>(2 * u + v));
  return pixels;
}

CameraCalibration calibration_of(DistortionModel model, std::vector<double> distortion) {
  CameraCalibration calibration{
      width, height, {50, 0, 31, 0, 52, 23, 0, 0, 1}, std::move(distortion), model};
  calibration.projection = {45, 0, 30, 0, 0, 46, 22, 0, 0, 0, 1, 0};
  return calibration;
}

/// Radius in the image as taken over the radius without distortion, for a ray at `r` from the axis.
double bend(const CameraCalibration& c, double r) {
  const auto& k = c.distortion;
  if (c.model == DistortionModel::equidistant) {
    const double angle = std::atan(r), a2 = angle * angle;
    const double bent = angle * (1 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3]))));
    return r > 0 ? bent / r : 1;
  }
  const double r2 = r * r;
  if (k.empty()) return 1;
  const double above = 1 + r2 * (k[0] + r2 * (k[1] + (k.size() > 4 ? r2 * k[4] : 0)));
  const double below = k.size() < 8 ? 1 : 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
  return above / below;
}

/// Largest difference, in grey levels, to the ramp's formula where the ray is well inside.
double worst_difference(const CameraCalibration& calibration, const Image& image) {
  double worst = 0;
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) {
      const double x = (u - 30) / 45.0, y = (v - 22) / 46.0;
      const double scale = bend(calibration, std::hypot(x, y));
      const double column = 50 * scale * x + 31, row = 52 * scale * y + 23;
      if (column < 1 || row < 1 || column > width - 2 || row > height - 2) continue;
      const int found = image.pixels[static_cast<std::size_t>(v * width + u)];
      worst = std::fmax(worst, std::fabs(found - (2 * column + row)));
    }
  return worst;
}

TEST_CASE("rectified pixels are read where the distortion formulas say") {
  const auto pixels = ramp();
  const ImageView view{pixels.data(), width, height, 1, width};
  for (const auto& [model, distortion] :
       {std::pair{DistortionModel::none, std::vector<double>{}},
        {DistortionModel::plumb_bob, {}},
        {DistortionModel::plumb_bob, {-0.2, 0.05, 0, 0}},
        {DistortionModel::plumb_bob, {-0.2, 0.05, 0, 0, 0.01}},
        {DistortionModel::rational_polynomial, {0.3, 0.1, 0, 0, 0.02, 0.5, 0.05, 0.01}},
        {DistortionModel::equidistant, {0.05, -0.02, 0.003, 0.001}}}) {
    const auto calibration = calibration_of(model, distortion);
    const Image image = rectify_image(view, calibration);
    CHECK(image.width == width);
    CHECK(image.height == height);
    CHECK(image.channels == 1);
    INFO(std::string(choice_name(model)), " with ", distortion.size());
    CHECK(worst_difference(calibration, image) < 0.7);  // rounding, and 1/32 pixel in OpenCV
  }
}

TEST_CASE("padded rows change nothing, and what the camera did not see is black") {
  std::mt19937 random(4);
  std::vector<std::uint8_t> padded(height * (3 * width + 7));
  for (auto& byte : padded) byte = static_cast<std::uint8_t>(1 + random() % 255U);
  const ImageView view{padded.data(), width, height, 3, 3 * width + 7};
  auto calibration = calibration_of(DistortionModel::none, {});
  calibration.projection = {50, 0, 31, 0, 0, 52, 23, 0, 0, 0, 1, 0};
  const Image same = rectify_image(view, calibration);
  for (int v = 0; v < height; ++v)
    for (int i = 0; i < 3 * width; ++i)
      REQUIRE(same.pixels[static_cast<std::size_t>(v * 3 * width + i)] == view.pixel(v, 0)[i]);
  calibration.projection[2] += 10;  // the left ten columns lie beside the image
  const Image moved = rectify_image(view, calibration);
  CHECK(moved.pixels[9 * 3] == 0);
  CHECK(moved.pixels[10 * 3] == view.pixel(0, 0)[0]);
}

TEST_CASE("rectifying refuses what is no calibration") {
  const auto pixels = ramp();
  const ImageView view{pixels.data(), width, height, 1, width};
  const auto refused = [&](auto change, const char* words) {
    auto calibration = calibration_of(DistortionModel::plumb_bob, {-0.2, 0.05, 0, 0});
    change(calibration);
    check_refused<DataError>([&] { rectify_image(view, calibration); }, words);
  };
  refused([](auto& c) { c.camera_matrix = {}; }, "the camera matrix has focal lengths 0.0");
  refused([](auto& c) { c.camera_matrix[4] = -52; }, "focal lengths");
  refused([](auto& c) { c.camera_matrix[2] = std::nan(""); }, "the camera matrix is not finite");
  refused([](auto& c) { c.camera_matrix[1] = 2; }, "fx 0 cx");
  refused([](auto& c) { c.projection = {}; }, "projection matrix is singular");
  refused([](auto& c) { c.projection[0] = -45; }, "the projection matrix has focal lengths");
  refused([](auto& c) { c.rectification = {}; }, "the rectification is no rotation");
  refused([](auto& c) { c.rectification[0] = -1; }, "the rectification is no rotation");
  refused([](auto& c) { c.distortion = {1, 2, 3}; }, "3 coefficients, plumb_bob has 4 or 5");
  refused([](auto& c) { c.distortion[0] = std::nan(""); }, "the distortion is not finite");
  refused([](auto& c) { c.model = DistortionModel::none; }, "4 coefficients, none has none");
  refused([](auto& c) { c.model = DistortionModel::rational_polynomial; }, "has 8");
  auto other = calibration_of(DistortionModel::none, {});
  other.width = 640;
  check_refused<ShapeError>([&] { rectify_image(view, other); },
                            "the image is 64x48, its calibration is for 640x48");
  check_refused<DataError>([&] { rectify_image({}, other); }, "empty");
}

TEST_CASE("a mosaic of one colour becomes an image of that colour, for each pattern") {
  constexpr std::uint8_t color[3] = {200, 90, 30};
  constexpr int channel_at[4][4] = {{0, 1, 1, 2}, {2, 1, 1, 0}, {1, 2, 0, 1}, {1, 0, 2, 1}};
  for (std::size_t pattern = 0; pattern < 4; ++pattern) {
    std::vector<std::uint8_t> mosaic;
    for (int v = 0; v < 7; ++v)
      for (int u = 0; u < 9; ++u) mosaic.push_back(color[channel_at[pattern][2 * (v % 2) + u % 2]]);
    const Image image = demosaic({mosaic.data(), 9, 7, 1, 9}, static_cast<BayerPattern>(pattern));
    REQUIRE(image.pixels.size() == 3 * 63);
    for (std::size_t i = 0; i < image.pixels.size(); ++i) CHECK(image.pixels[i] == color[i % 3]);
  }
}

TEST_CASE("no mosaic is made of colours or of next to no pixels") {
  const std::vector<std::uint8_t> pixels(300);
  check_refused<ShapeError>([&] { demosaic({pixels.data(), 10, 10, 3, 30}, BayerPattern::rggb); },
                            "3 channels");
  check_refused<DataError>([&] { demosaic({pixels.data(), 3, 10, 1, 3}, BayerPattern::rggb); },
                           "3x10");
  check_refused<DataError>([&] { demosaic({}, BayerPattern::rggb); }, "empty");
}

}  // namespace
}  // namespace fusionslam
