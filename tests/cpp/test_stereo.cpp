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

// The rectified colour pair of KITTI, but with principal points that differ in x.
constexpr Projection kitti_left{721.5377, 0,         609.5593, 44.85728, 0, 721.5377,
                                172.854,  0.2163791, 0,        0,        1, 0.002745884};
constexpr Projection kitti_right{721.5377, 0,        612.25, -339.5242, 0, 721.5377,
                                 172.854,  2.199936, 0,      0,         1, 0.002729905};
constexpr int width = 1242;
constexpr int height = 375;

/// Depth of the made-up surface at a pixel: 4 m to 74 m.
double depth_at(int u, int v) { return 4 + (7 * u + 13 * v) % 71; }

std::array<double, 3> point_at(int u, int v) {
  const double z = depth_at(u, v), w = z + kitti_left[11];
  return {(u * w - kitti_left[2] * z - kitti_left[3]) / kitti_left[0],
          (v * w - kitti_left[6] * z - kitti_left[7]) / kitti_left[5], z};
}

double disparity_at(int u, int v) {
  const auto p = point_at(u, v);
  return u - (kitti_right[0] * p[0] + kitti_right[2] * p[2] + kitti_right[3]) /
                 (p[2] + kitti_right[11]);
}

std::vector<float> made_up_disparity() {
  std::vector<float> disparity;
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u)
      disparity.push_back(v % 5 == 0 ? static_cast<float>(disparity_at(u, v)) : 0.0F);
  return disparity;
}

/// One grey level a pixel, so that a colour identifies its pixel.
std::vector<std::uint8_t> grey_ramp() {
  std::vector<std::uint8_t> image;
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u) image.push_back(static_cast<std::uint8_t>((u + 3 * v) % 256));
  return image;
}

TEST_CASE("a cloud from disparity inverts the projection of a KITTI pair") {
  const auto image = grey_ramp();
  StereoCalibration calibration{kitti_left, kitti_right, {}};
  // The cloud's x is forward, y left, z up.
  calibration.cloud_from_rectified = {0, 0, 1, 0.27, -1, 0, 0, 0.06, 0, -1, 0, -0.08, 0, 0, 0, 1};
  const auto cloud = cloud_from_disparity(made_up_disparity(),
                                          {image.data(), width, height, 1, width}, calibration);
  REQUIRE(cloud.size() == static_cast<std::size_t>(width * 75));
  double worst = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const int u = static_cast<int>(cloud.indices[i] % width);
    const int v = static_cast<int>(cloud.indices[i] / width);
    const auto p = point_at(u, v);
    const double expected[3] = {p[2] + 0.27, -p[0] + 0.06, -p[1] - 0.08};
    for (std::size_t c = 0; c < 3; ++c)
      worst = std::fmax(worst, std::fabs(cloud.points[3 * i + c] - expected[c]) / p[2]);
    if (cloud.colors[3 * i + 1] != (u + 3 * v) % 256) FAIL("a colour of another pixel");
  }
  CHECK(worst < 2e-6);
}

TEST_CASE("points outside the range are dropped") {
  const auto image = grey_ramp();
  StereoConfig config;
  config.min_range = 10;
  config.max_range = 20;
  const auto cloud =
      cloud_from_disparity(made_up_disparity(), {image.data(), width, height, 1, width},
                           {kitti_left, kitti_right}, config);
  CHECK(cloud.size() > 0);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float z = cloud.points[3 * i + 2];
    if (z < 9.9999F || z > 20.0001F) FAIL("a point out of range");
  }
}

/// Random texture seen by the left camera, and shifted by `shift` pixels by the right one.
struct Pair {
  std::vector<std::uint8_t> left, right;
  static constexpr int width = 160, height = 60;

  explicit Pair(int shift) {
    std::mt19937 random(11);
    for (int v = 0; v < height; ++v) {
      std::vector<std::uint8_t> row;
      for (int u = 0; u < width + shift; ++u)
        row.push_back(static_cast<std::uint8_t>(random() & 255U));
      left.insert(left.end(), row.begin(), row.begin() + width);
      right.insert(right.end(), row.begin() + shift, row.begin() + shift + width);
    }
  }

  ImageView left_view() const { return {left.data(), width, height, 1, width}; }
  ImageView right_view() const { return {right.data(), width, height, 1, width}; }
};

TEST_CASE("both methods find the shift of a textured pair") {
  const Pair pair(12);
  for (const StereoMethod method : {StereoMethod::bm, StereoMethod::sgbm}) {
    StereoConfig config;
    config.method = method;
    config.block_size = 9;
    const auto disparity = stereo_disparity(pair.left_view(), pair.right_view(), config);
    REQUIRE(disparity.size() == 160 * 60);
    int fine = 0;
    for (std::size_t v = 10; v < 50; ++v)
      for (std::size_t u = 80; u < 150; ++u) fine += std::fabs(disparity[v * 160 + u] - 12) < 0.25F;
    INFO(std::string(choice_name(method)));
    CHECK(fine > 0.95 * 40 * 70);
    CHECK(disparity[30 * 160 + 2] == 0);  // searched outside the right image
  }
}

TEST_CASE("images narrower than the search range have no disparity") {
  const Pair pair(1);
  ImageView left = pair.left_view(), right = pair.right_view();
  left.width = right.width = 30;
  for (const StereoMethod method : {StereoMethod::bm, StereoMethod::sgbm}) {
    StereoConfig config;
    config.method = method;
    const auto disparity = stereo_disparity(left, right, config);
    CHECK(disparity == std::vector<float>(30 * 60, 0.0F));
  }
}

TEST_CASE("stereo refuses images of two sizes and settings that OpenCV does not take") {
  const Pair pair(1);
  ImageView small = pair.right_view();
  small.height = 50;
  check_refused<ShapeError>([&] { stereo_disparity(pair.left_view(), small); }, "160x50");
  const auto refused = [&](auto change, const char* words) {
    StereoConfig config;
    change(config);
    check_refused<ConfigError>(
        [&] { stereo_disparity(pair.left_view(), pair.right_view(), config); }, words);
  };
  refused([](StereoConfig& c) { c.num_disparities = 50; }, "stereo.num_disparities is 50");
  refused([](StereoConfig& c) { c.block_size = 20; }, "stereo.block_size is 20");
  refused([](StereoConfig& c) { c.block_size = 3; }, "stereo.block_size is 3");
  refused([](StereoConfig& c) { c.block_size = 61; }, "stereo.block_size is 61");
  refused([](StereoConfig& c) { c.pre_filter_size = 6; }, "stereo.pre_filter_size is 6");
  refused([](StereoConfig& c) { c.min_range = 90; }, "stereo.min_range");
  refused(
      [](StereoConfig& c) {
        c.method = StereoMethod::sgbm;
        c.p1 = c.p2;
      },
      "stereo.p1");
}

TEST_CASE("a cloud from disparity refuses what is no rectified pair") {
  const Pair pair(1);
  const std::vector<float> disparity(160 * 60, 5.0F);
  const auto refused = [&](const Projection& left, const Projection& right, const char* words) {
    check_refused<DataError>(
        [&] { cloud_from_disparity(disparity, pair.left_view(), {left, right}); }, words);
  };
  refused(kitti_left, kitti_left, "no baseline");
  refused(kitti_right, kitti_left, "exchanged");
  refused(kitti_left, {}, "singular");
  Projection other = kitti_right;
  other[0] = 700;
  refused(kitti_left, other, "rectified");
  check_refused<ShapeError>(
      [&] {
        cloud_from_disparity(std::vector<float>(7), pair.left_view(), {kitti_left, kitti_right});
      },
      "7 pixels");
}

}  // namespace
}  // namespace fusionslam
