// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The hot loops of the sheet of pose cells on every level of this machine, and its C++ face.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/ratslam/pose_cells.hpp"
#include "levels.hpp"
#include "ratslam/sheet_kernel.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using detail::sheet_kernels;
using detail::SheetKernels;
using detail::Window;
using testing::check_refused;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

std::vector<double> random_numbers(std::size_t count, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> number(0, 1);
  std::vector<double> result(count);
  for (double& value : result) value = number(generator);
  return result;
}

/// Everything that the kernels give for `count` numbers, one after the other.
std::vector<double> everything(const SheetKernels& kernels, std::size_t count) {
  const std::vector<double> a = random_numbers(count + 60, 1), b = random_numbers(count + 60, 2);
  const Window window{{0.4, 0.2, 0.07, 0.03}};
  std::vector<double> result, out(count);
  const auto keep = [&] { result.insert(result.end(), out.begin(), out.end()); };
  for (const std::size_t stride : {1, 9}) {
    kernels.blur3(a.data() + 30, stride, count, window, out.data());
    keep();
    kernels.blur2(a.data() + 30, stride, count, window, out.data());
    keep();
  }
  result.push_back(kernels.inhibit(a.data(), b.data(), 0.01, count, out.data()));
  keep();
  kernels.scale(1.7, count, out.data());
  keep();
  kernels.mix(a.data(), 0.3, b.data(), 0.7, count, out.data());
  keep();
  result.push_back(kernels.largest(a.data(), count));
  return result;
}

TEST_CASE("every SIMD level gives the same bits, whatever is left of a row") {
  for (const std::size_t count : {0, 1, 7, 16, 31, 400, 1003}) {
    const std::vector<double> expected = everything(sheet_kernels(SimdLevel::baseline), count);
    for (const SimdLevel level : simd_levels())
      CHECK(everything(sheet_kernels(level), count) == expected);
  }
}

TEST_CASE("the window is laid over both sides") {
  const std::vector<double> in = random_numbers(60, 3);
  const Window window{{0.4, 0.2, 0.07, 0.03}};
  std::vector<double> out(12);
  for (const SimdLevel level : simd_levels()) {
    sheet_kernels(level).blur3(in.data() + 20, 5, out.size(), window, out.data());
    for (std::size_t i = 0; i < out.size(); ++i) {
      double sum = 0;
      for (int k = -3; k <= 3; ++k) sum += window.weights[std::abs(k)] * in[20 + i + 5 * k];
      CHECK(out[i] == doctest::Approx(sum));
    }
  }
}

TEST_CASE("a packet that settles and moves keeps its sum and goes where it is sent") {
  PoseSheet sheet(21);
  CHECK(sheet.size() == 21);
  REQUIRE(sheet.activity().size() == 36 * 21 * 21);
  for (int step = 0; step < 50; ++step) {
    sheet.settle(2e-5);
    sheet.move(std::vector<double>(36, 0.5), std::vector<double>(36, -1.0), 0.25);
  }
  const auto cells = sheet.activity();
  CHECK(*std::min_element(cells.begin(), cells.end()) >= 0);
  CHECK(std::accumulate(cells.begin(), cells.end(), 0.0) == doctest::Approx(1));
  const SheetPlace place = sheet.decode();
  // From (10, 10, 18), on the torus; the attractor holds packets back between cells.
  CHECK(place.y == doctest::Approx((10 + 63 - 50) % 21).epsilon(0.01));
  CHECK(std::abs(place.x - (10 + 25 - 21)) < 5);
  CHECK(place.th >= 0);
  CHECK(place.th < PoseSheet::headings);
}

TEST_CASE("what is taken over is what was stored") {
  PoseSheet sheet(7), other(7);
  sheet.settle(0);
  other.assign(sheet.activity());
  sheet.inject({6.5, -0.5, 35.5}, 0.5);
  other.inject({-0.5, 6.5, -0.5}, 0.5);
  CHECK(std::equal(sheet.activity().begin(), sheet.activity().end(), other.activity().begin()));
}

TEST_CASE("sheets refuse what cannot be and stay as they were") {
  check_refused<ConfigError>([] { PoseSheet(6); }, "pose_cells.size is 6, expected 7 to 1000");
  check_refused<ConfigError>([] { PoseSheet(1001); }, "expected 7 to 1000");
  PoseSheet sheet(7);
  sheet.settle(2e-5);
  const std::vector<double> before(sheet.activity().begin(), sheet.activity().end());
  const std::vector<double> still(36), broken(36, nan);
  check_refused<ShapeError>([&] { sheet.assign(still); }, "36 cells, expected 1764");
  check_refused<DataError>([&] { sheet.assign(std::vector<double>(1764)); }, "over 0");
  check_refused<DataError>([&] { sheet.assign(std::vector<double>(1764, -1)); }, "0 or more");
  check_refused<ShapeError>([&] { sheet.move(still, {}, 0); }, "36 and 0 layers, expected 36");
  check_refused<DataError>([&] { sheet.move(still, broken, 0); }, "not finite");
  check_refused<DataError>([&] { sheet.move(still, still, nan); }, "not finite");
  check_refused<DataError>([&] { sheet.inject({0, nan, 0}, 1); }, "energy of 0 or more");
  check_refused<DataError>([&] { sheet.inject({0, 0, 0}, -1); }, "energy of 0 or more");
  check_refused<ConfigError>([&] { sheet.settle(1); }, "leaves no cell active");
  CHECK(std::equal(before.begin(), before.end(), sheet.activity().begin()));
}

}  // namespace
}  // namespace fusionslam
