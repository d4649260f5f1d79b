// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <random>
#include <vector>

#include "fusion/exposure.hpp"
#include "fusionslam/fusion.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;

constexpr double third = 1.0 / 3;
/// Look along z and along x.
constexpr Projection ahead{10, 0, 19.5, 0, 0, 10, 14.5, 0, 0, 0, 1, 0};
constexpr Projection aside{19.5, 0, -10, 0, 14.5, 10, 0, 0, 1, 0, 0, 0};

std::vector<float> points_around(std::size_t size) {
  std::mt19937 random(2);
  std::uniform_real_distribution<float> uniform(-5, 5);
  std::vector<float> points(3 * size);
  for (float& value : points) value = uniform(random);
  return points;
}

std::vector<std::uint8_t> plain_image(std::uint8_t value) {
  return std::vector<std::uint8_t>(40UL * 30UL, value);
}

ImageView view_of(const std::vector<std::uint8_t>& pixels) {
  return {pixels.data(), 40, 30, 1, 40};
}

TEST_CASE("each point is seen by the camera whose centre is nearest, and by nobody else") {
  const auto points = points_around(3000);
  const PointsView view{points.data(), 3000};
  const auto first = plain_image(10), second = plain_image(20);
  const std::vector<CameraView> cameras{{view_of(first), ahead}, {view_of(second), aside}};
  const auto both = colorize_all_round(view, cameras, false);
  const auto a = colorize(view, view_of(first), ahead), b = colorize(view, view_of(second), aside);
  std::vector<std::int64_t> expected;
  std::set_union(a.indices.begin(), a.indices.end(), b.indices.begin(), b.indices.end(),
                 std::back_inserter(expected));
  CHECK(both.cloud.indices == expected);
  CHECK(expected.size() < a.size() + b.size());
  for (std::size_t k = 0; k < expected.size(); ++k) {
    CHECK(both.cloud.colors[3 * k] == (both.cameras[k] == 0 ? 10 : 20));
    const float* point = view[static_cast<std::size_t>(expected[k])];
    // In the overlap the two cameras are mirror images about x = z.
    if (point[2] > 0 && point[0] > point[2] * 1.0001F) CHECK(both.cameras[k] == 1);
    if (point[0] > 0 && point[2] > point[0] * 1.0001F) CHECK(both.cameras[k] == 0);
  }
}

TEST_CASE("contradictory pairs of cameras are evened out by least squares") {
  detail::Exposures exposures(4);
  for (int k = 0; k < 31; ++k) {
    exposures.add(0, {100, 100, 100}, 1, {50, 100, 10});
    exposures.add(1, {100, 100, 100}, 2, {100, 100, 100});
    exposures.add(0, {100, 100, 100}, 2, {100, 100, 100});
  }
  for (int k = 0; k < 29; ++k) exposures.add(2, {100, 100, 100}, 3, {50, 50, 50});
  const auto gains = exposures.gains();
  const double expected[4] = {std::pow(2, -third), std::pow(2, third), 1, 1};
  for (std::size_t k = 0; k < 4; ++k) {
    CHECK(gains[k][0] == doctest::Approx(expected[k]).epsilon(1e-3));
    CHECK(gains[k][1] == 1);
    CHECK(gains[k][2] == 1);  // 10 is too dark to say anything
  }
}

TEST_CASE("more points weigh more") {
  detail::Exposures exposures(3);
  for (int k = 0; k < 60; ++k) exposures.add(0, {100, 100, 100}, 1, {50, 50, 50});
  for (int k = 0; k < 30; ++k) {
    exposures.add(1, {100, 100, 100}, 2, {100, 100, 100});
    exposures.add(0, {100, 100, 100}, 2, {100, 100, 100});
  }
  // The loop's error of log 2 is shared as 1/2 : 1 : 1.
  const auto gains = exposures.gains();
  CHECK(gains[1][0] / gains[0][0] == doctest::Approx(std::pow(2, 0.8)).epsilon(1e-3));
  CHECK(gains[2][0] / gains[1][0] == doctest::Approx(std::pow(2, -0.4)).epsilon(1e-3));
}

TEST_CASE("no camera, or too many, are refused") {
  const auto points = points_around(10);
  const auto image = plain_image(10);
  const PointsView view{points.data(), 10};
  check_refused<DataError>([&] { (void)colorize_all_round(view, {}); }, "0 cameras");
  const std::vector<CameraView> many(256, CameraView{view_of(image), ahead});
  check_refused<DataError>([&] { (void)colorize_all_round(view, many); }, "256 cameras");
}

}  // namespace
}  // namespace fusionslam
