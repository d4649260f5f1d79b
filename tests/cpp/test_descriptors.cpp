// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <string_view>
#include <thread>

#include "clouds.hpp"
#include "fusionslam/descriptors.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;
using testing::Cloud;

/// A descriptor with everything but cloud and threads fixed.
struct Described {
  const char* name;
  std::size_t length;
  std::function<std::vector<float>(const Cloud&, int threads)> describe;
};

const std::vector<Described>& all_descriptors() {
  static const auto coloured = [](ColorSpace space, const char* preset) {
    return [=](const Cloud& c, int threads) {
      return cm2dp(c.points_view(), c.colors_view(), space, m2dp_preset(preset), threads);
    };
  };
  static const auto plain = [](const char* preset) {
    return [=](const Cloud& c, int threads) {
      return m2dp(c.points_view(), m2dp_preset(preset), threads);
    };
  };
  static const std::vector<Described> all{
      {"m2dp robust", 192, plain("robust")},
      {"m2dp upright", 192, plain("upright")},
      {"m2dp author", 192, plain("author")},
      {"m2dp paper", 192, plain("paper")},
      {"cm2dp rgb robust", 576, coloured(ColorSpace::rgb, "robust")},
      {"cm2dp hsv paper", 576, coloured(ColorSpace::hsv, "paper")},
      {"cm2dp lab author", 576, coloured(ColorSpace::lab, "author")},
      {"shot", 352,
       [](const Cloud& c, int threads) { return shot(c.points_view(), std::nullopt, threads); }},
      {"cshot", 1344,
       [](const Cloud& c, int threads) {
         return cshot(c.points_view(), c.colors_view(), std::nullopt, threads);
       }},
      {"cscan_context", 3600,
       [](const Cloud& c, int) { return cscan_context(c.points_view(), c.colors_view()); }},
      {"bev_spectrum", 4320, [](const Cloud& c, int) { return bev_spectrum(c.points_view()); }},
      {"scan_context_cartesian", 1600,
       [](const Cloud& c, int) { return scan_context_cartesian(c.points_view()); }},
      {"iris", 28800, [](const Cloud& c, int) { return iris(c.points_view()); }},
      {"solid", 40, [](const Cloud& c, int) { return solid(c.points_view()); }},
      {"ring", 7200, [](const Cloud& c, int) { return ring(c.points_view()); }},
      {"ndt_histogram", 220, [](const Cloud& c, int) { return ndt_histogram(c.points_view()); }}};
  return all;
}

/// Runs a check once for each descriptor, with its name in the report.
template <class Check>
void for_each_descriptor(Check&& check) {
  for (const Described& described : all_descriptors()) {
    INFO(std::string(described.name));
    check(described);
  }
}

TEST_CASE("descriptors have their lengths and finite values") {
  const Cloud cloud = testing::random_cloud(2000);
  for_each_descriptor([&](const Described& d) {
    const auto values = d.describe(cloud, 1);
    CHECK(values.size() == d.length);
    CHECK(std::ranges::all_of(values, [](float v) { return std::isfinite(v); }));
  });
}

TEST_CASE("descriptors are equal to the last bit for one and two threads") {
  const Cloud cloud = testing::random_cloud(3000);
  for_each_descriptor(
      [&](const Described& d) { CHECK(d.describe(cloud, 1) == d.describe(cloud, 2)); });
}

TEST_CASE("two calls at once give what one gives") {
  const Cloud first = testing::random_cloud(2000, 1);
  const Cloud second = testing::random_cloud(2000, 2);
  for_each_descriptor([&](const Described& d) {
    std::vector<float> from_thread, meanwhile;
    {
      const std::jthread thread([&] { from_thread = d.describe(first, 2); });
      meanwhile = d.describe(second, 2);
    }
    CHECK(from_thread == d.describe(first, 1));
    CHECK(meanwhile == d.describe(second, 1));
  });
}

TEST_CASE("the signature of every preset sums to its number of rows") {
  const Cloud cloud = testing::random_cloud(1000);
  for (const char* preset : {"robust", "upright", "paper", "author"}) {
    INFO(std::string(preset));
    const auto signature = m2dp_signature(cloud.points_view(), m2dp_preset(preset));
    REQUIRE(signature.rows == 64);
    REQUIRE(signature.columns == 128);
    REQUIRE(signature.values.size() == 64 * 128);
    double sum = 0;
    for (const double value : signature.values) sum += value;
    // The author's program leaves the last of the 1000 points out.
    CHECK(sum == doctest::Approx(64).epsilon(0.0011));
    CHECK(*std::ranges::min_element(signature.values) >= 0);
  }
  CHECK(cm2dp_signature(cloud.points_view(), cloud.colors_view()).columns == 512);
}

TEST_CASE("the halves of M2DP are unit vectors without negative entries") {
  const auto values = m2dp(testing::random_cloud(1000).points_view());
  double left = 0, right = 0;
  for (std::size_t i = 0; i < 192; ++i) (i < 64 ? left : right) += std::pow(values[i], 2);
  CHECK(left == doctest::Approx(1));
  CHECK(right == doctest::Approx(1));
  CHECK(*std::ranges::min_element(values) >= -1e-6F);
}

void check_unchanged(const Cloud& cloud, const Cloud& changed) {
  CHECK(testing::distance(m2dp(cloud.points_view()), m2dp(changed.points_view())) <= 1e-4);
  CHECK(testing::distance(cm2dp(cloud.points_view(), cloud.colors_view()),
                          cm2dp(changed.points_view(), changed.colors_view())) <= 1e-4);
}

TEST_CASE("turning a cloud leaves the robust descriptor unchanged") {
  const Cloud cloud = testing::random_cloud(20000);
  for (const double angle : {0.3, 1.7, 3.1})
    check_unchanged(cloud, testing::transform(cloud, testing::rotation(angle), {0, 0, 0}));
}

TEST_CASE("turning a cloud about z and shifting it leaves the upright descriptor unchanged") {
  const Cloud cloud = testing::random_cloud(20000);
  const M2dpConfig upright = m2dp_preset("upright");
  const auto known = m2dp(cloud.points_view(), upright);
  for (const double yaw : {0.3, 1.7, 3.1}) {
    const double c = std::cos(yaw), s = std::sin(yaw);
    const Cloud turned = testing::transform(cloud, {c, -s, 0, s, c, 0, 0, 0, 1}, {12, -30, 4});
    CHECK(testing::distance(m2dp(turned.points_view(), upright), known) <= 1e-4);
  }
}

TEST_CASE("shifting a cloud leaves the robust descriptor unchanged") {
  const Cloud cloud = testing::random_cloud(20000);
  check_unchanged(cloud, testing::transform(cloud, testing::rotation(0), {12, -30, 4}));
}

TEST_CASE("flipping an axis leaves the robust descriptor unchanged") {
  const Cloud cloud = testing::random_cloud(20000);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    testing::Rotation mirror = testing::rotation(0);
    mirror[4 * axis] = -1;
    check_unchanged(cloud, testing::transform(cloud, mirror, {0, 0, 0}));
  }
}

TEST_CASE("another cloud has another robust descriptor") {
  const auto first = m2dp(testing::random_cloud(20000).points_view());
  Cloud other = testing::random_cloud(20000);
  for (std::size_t i = 0; i < other.points.size(); i += 3) other.points[i] *= other.points[i];
  CHECK(testing::distance(first, m2dp(other.points_view())) > 0.01);
}

Cloud cloud_of(std::vector<float> points) {
  Cloud cloud{std::move(points), {}};
  cloud.colors.assign(cloud.points.size(), 100);
  return cloud;
}

/// `make(i)` is the i-th of 100 points.
template <class Make>
Cloud hundred_points(Make&& make) {
  std::vector<float> points;
  for (int i = 0; i < 100; ++i)
    for (const double value : make(i)) points.push_back(static_cast<float>(value));
  return cloud_of(points);
}

/// The descriptors whose axes are those of the cloud, which it has to have.
template <class Check>
void for_each_with_own_axes(Check&& check) {
  static constexpr std::array<std::string_view, 8> upright{
      "m2dp upright", "cscan_context", "bev_spectrum", "scan_context_cartesian",
      "iris",         "solid",         "ring",         "ndt_histogram"};
  for_each_descriptor([&](const Described& d) {
    if (std::ranges::find(upright, d.name) == upright.end()) check(d);
  });
}

TEST_CASE("clouds without points or with three are refused") {
  const Cloud empty, three = cloud_of({0, 0, 0, 1, 0, 0, 0, 1, 0});
  for_each_with_own_axes([&](const Described& d) {
    check_refused<DataError>([&] { d.describe(empty, 1); }, "0 points");
    check_refused<DataError>([&] { d.describe(three, 1); }, "3 points");
  });
}

TEST_CASE("a cloud of equal points is refused") {
  const Cloud cloud = hundred_points([](int) { return std::array{1.0, 2.0, 3.0}; });
  for_each_with_own_axes([&](const Described& d) {
    check_refused<DataError>([&] { d.describe(cloud, 1); }, "equal");
  });
}

TEST_CASE("points on one line are refused, however the line runs") {
  for (const auto& direction :
       {std::array{1.0, 0.0, 0.0}, std::array{0.3, -0.2, 0.7}, std::array{1.0, 1.0, 1.0}}) {
    const Cloud cloud = hundred_points([&](int i) {
      return std::array{5 + direction[0] * i, 3 + direction[1] * i, direction[2] * i};
    });
    for_each_with_own_axes(
        [&](const Described& d) { check_refused<DataError>([&] { d.describe(cloud, 1); }, ""); });
  }
}

TEST_CASE("upright axes need points off one vertical line") {
  const auto describe = [](const Cloud& c) { m2dp(c.points_view(), m2dp_preset("upright")); };
  const Cloud vertical = hundred_points([](int i) { return std::array{1.0, 2.0, 0.1 * i}; });
  check_refused<DataError>([&] { describe(vertical); }, "vertical line");
  describe(hundred_points([](int i) { return std::array{1.0, 0.1 * i, 2.0}; }));
}

TEST_CASE("a bird's-eye spectrum needs points above the ground within its range") {
  const auto describe = [](const Cloud& c) { bev_spectrum(c.points_view()); };
  check_refused<DataError>([&] { describe({}); }, "0 points");
  check_refused<DataError>([&] { describe(cloud_of({1000, 0, 0})); }, "higher than");
  check_refused<DataError>([&] { describe(cloud_of({0, 0, -100})); }, "higher than");
  describe(cloud_of({1, 0, 0}));
}

TEST_CASE("a bird's-eye spectrum is fitted to how far a cloud reaches, and to its ground") {
  const auto fit = [](double reach, double ground) {
    // A floor of a point each 0.25 m, with a pole that is higher and a pit that is lower.
    Cloud cloud;
    const int count = static_cast<int>(4 * reach);
    for (int row = -count; row <= count; ++row)
      for (int column = -count; column <= count; ++column)
        if (row * row + column * column < count * count) {
          const double z = std::abs(row) < 2 && column > 0 ? ground - 3 : ground;
          for (const double value : {row / 4.0, column / 4.0, z})
            cloud.points.push_back(static_cast<float>(value));
        }
    return fit_bev_spectrum(cloud.points_view());
  };
  for (const auto& [reach, cell] : {std::pair{3.0, 0.125},
                                    {11.0, 0.5 / std::sqrt(2)},
                                    {27.5, 1.0},
                                    {55.0, 2.0},
                                    {80.0, 2.0},
                                    {0.3, 0.125}}) {
    const BevSpectrumConfig fitted = fit(reach, -1.2);
    CHECK(fitted.cell == doctest::Approx(cell));
    if (reach > 3) CHECK(fitted.height == doctest::Approx(1.2 + cell / 10));
  }
  CHECK(fit(11.0, 0).height == doctest::Approx(0.05 / std::sqrt(2)));
  check_refused<DataError>([] { fit_bev_spectrum({}); }, "0 points");
  const Cloud bad = cloud_of({std::nanf(""), 0, 0});
  check_refused<DataError>([&] { fit_bev_spectrum(bad.points_view()); }, "point 0");
}

TEST_CASE("colours of a Scan Context are as many as its points") {
  const Cloud cloud = testing::random_cloud(50);
  const ColorsView colors{cloud.colors.data(), 49};
  check_refused<ShapeError>([&] { cscan_context(cloud.points_view(), colors); }, "49 rows");
  check_refused<DataError>([] { cscan_context({}, {}); }, "0 points");
}

TEST_CASE("NaN and infinity are refused with the number of the point") {
  for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity()}) {
    Cloud cloud = testing::random_cloud(50);
    cloud.points[3 * 17 + 1] = bad;
    for_each_descriptor([&](const Described& d) {
      check_refused<DataError>([&] { d.describe(cloud, 1); }, "point 17");
    });
  }
}

TEST_CASE("colours of another length are refused") {
  const Cloud cloud = testing::random_cloud(50);
  const ColorsView colors{cloud.colors.data(), 49};
  check_refused<ShapeError>([&] { cm2dp(cloud.points_view(), colors); }, "49 rows");
  check_refused<ShapeError>([&] { cshot(cloud.points_view(), colors); }, "49 rows");
}

TEST_CASE("a flat cloud is described") {
  Cloud cloud = testing::random_cloud(2000);
  for (std::size_t i = 2; i < cloud.points.size(); i += 3) cloud.points[i] = 1.5F;
  for_each_descriptor([&](const Described& d) {
    const auto values = d.describe(cloud, 1);
    CHECK(values.size() == d.length);
    CHECK(std::ranges::all_of(values, [](float v) { return std::isfinite(v); }));
  });
}

TEST_CASE("normals point out of a plane towards the origin and name their points") {
  std::vector<float> points;
  for (int i = 0; i < 100; ++i)
    points.insert(points.end(), {static_cast<float>(i % 10), static_cast<float>(i / 10), -2.0F});
  points.insert(points.end(), {500, 500, 500});  // alone: no normal
  const auto normals = estimate_normals({points.data(), 101}, 1.5, 2);
  REQUIRE(normals.indices.size() == 100);
  for (std::size_t i = 0; i < 100; ++i) {
    CHECK(normals.indices[i] == static_cast<std::int64_t>(i));
    CHECK(normals.normals[3 * i + 2] == doctest::Approx(1));
    CHECK(normals.curvatures[i] == doctest::Approx(0));
  }
}

TEST_CASE("the resolution is the mean distance to the nearest neighbour") {
  const Cloud cloud = testing::random_cloud(300);
  double sum = 0;
  for (std::size_t i = 0; i < 300; ++i) {
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < 300; ++j) {
      const float *a = cloud.points_view()[i], *b = cloud.points_view()[j];
      if (i != j) nearest = std::fmin(nearest, std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
    }
    sum += nearest;
  }
  CHECK(cloud_resolution(cloud.points_view()) == doctest::Approx(sum / 300).epsilon(1e-6));
  check_refused<DataError>([&] { cloud_resolution({cloud.points.data(), 1}); }, "1 point,");
}

}  // namespace
}  // namespace fusionslam
