// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>

#include "clouds.hpp"
#include "fusionslam/fusion.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;
using testing::Cloud;

/// Looks along z; skewed rows so that no entry goes unused.
constexpr Projection camera{40, 1, 31, 5, -1, 42, 19, 3, 0.01, -0.02, 1, 0.1};
/// Pixel (x / z, y / z).
constexpr Projection unit_camera{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

/// An image of random pixels whose rows are padded.
struct Image {
  std::vector<std::uint8_t> bytes;
  ImageView view;

  Image(int width, int height, int channels, unsigned seed = 5) {
    const auto row = static_cast<std::size_t>(width * channels) + 5;
    std::mt19937 random(seed);
    bytes.resize(row * static_cast<std::size_t>(height));
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random() & 255U);
    view = {bytes.data(), width, height, channels, row};
  }
};

/// Points all round the camera, half of them behind it.
Cloud cloud_around(std::size_t size) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> uniform(-10, 10);
  Cloud cloud;
  for (std::size_t i = 0; i < 3 * size; ++i) cloud.points.push_back(uniform(random));
  return cloud;
}

std::array<double, 3> naive_projection(const float* p, const Projection& m) {
  std::array<double, 3> h{};
  for (std::size_t row = 0; row < 3; ++row)
    h[row] = m[4 * row] * p[0] + m[4 * row + 1] * p[1] + m[4 * row + 2] * p[2] + m[4 * row + 3];
  return {h[0] / h[2], h[1] / h[2], h[2]};
}

void check_against_naive(int channels) {
  const Image image(64, 40, channels);
  const Cloud cloud = cloud_around(5000);
  const auto result = colorize(cloud.points_view(), image.view, camera);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < 5000; ++i) {
    const auto [u, v, depth] = naive_projection(cloud.points_view()[i], camera);
    const double column = std::floor(u + 0.5), row = std::floor(v + 0.5);
    if (depth <= 0 || column < 0 || row < 0 || column >= 64 || row >= 40) continue;
    REQUIRE(kept < result.size());
    CHECK(result.indices[kept] == static_cast<std::int64_t>(i));
    const auto* pixel = image.view.pixel(static_cast<int>(row), static_cast<int>(column));
    for (std::size_t c = 0; c < 3; ++c) {
      CHECK(result.points[3 * kept + c] == cloud.points[3 * i + c]);
      CHECK(result.colors[3 * kept + c] == pixel[channels == 3 ? c : 0]);
    }
    ++kept;
  }
  CHECK(result.size() == kept);
  CHECK(kept > 300);
}

TEST_CASE("colours are those of the pixels that a naive projection finds") {
  check_against_naive(3);
  check_against_naive(1);
}

TEST_CASE("points behind the camera and in its plane get no colour") {
  const Image image(4, 4, 3);
  const std::vector<float> points{-1, -1, -1, 0, 0, 0, 1, 1, 0, 1, 1, 1};
  const auto result = colorize({points.data(), 4}, image.view, unit_camera);
  CHECK(result.indices == std::vector<std::int64_t>{3});
}

TEST_CASE("a pixel reaches half a pixel around its centre, at the borders too") {
  const Image image(4, 3, 3);
  const auto inside = [&](float u, float v) {
    const std::vector<float> point{u, v, 1};
    return colorize({point.data(), 1}, image.view, unit_camera).size() == 1;
  };
  CHECK(inside(-0.5F, 0));
  CHECK_FALSE(inside(-0.50001F, 0));
  CHECK(inside(3.49999F, 0));
  CHECK_FALSE(inside(3.5F, 0));
  CHECK(inside(0, -0.5F));
  CHECK_FALSE(inside(0, -0.50001F));
  CHECK(inside(0, 2.49999F));
  CHECK_FALSE(inside(0, 2.5F));
  CHECK_FALSE(inside(1e30F, 0));
}

TEST_CASE("bilinear colours follow a ramp and stop at the outermost centres") {
  std::vector<std::uint8_t> ramp;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 4; ++column)
      ramp.push_back(static_cast<std::uint8_t>(20 * column + 50 * row));
  const ImageView image{ramp.data(), 4, 3, 1, 4};
  const std::vector<float> points{1.25F, 0.5F, 1, 2.5F, 1.75F, 1, -0.5F, 1, 1, 3.25F, 2.25F, 1};
  const auto result = colorize({points.data(), 4}, image, unit_camera, Interpolation::bilinear);
  CHECK(result.colors ==
        std::vector<std::uint8_t>{50, 50, 50, 138, 138, 138, 50, 50, 50, 160, 160, 160});
}

TEST_CASE("bilinear colours exist in an image of one pixel") {
  const std::vector<std::uint8_t> pixel{9, 8, 7};
  const std::vector<float> point{0.25F, -0.25F, 1};
  const auto result =
      colorize({point.data(), 1}, {pixel.data(), 1, 1, 3, 3}, unit_camera, Interpolation::bilinear);
  CHECK(result.colors == pixel);
}

TEST_CASE("the depth image keeps the nearest point of each pixel") {
  const Cloud cloud = cloud_around(5000);
  std::vector<float> expected(16 * 10, 0.0F);
  Projection small = camera;
  for (std::size_t i = 0; i < 8; ++i) small[i] /= 4;
  for (std::size_t i = 0; i < 5000; ++i) {
    const auto [u, v, depth] = naive_projection(cloud.points_view()[i], small);
    const double column = std::floor(u + 0.5), row = std::floor(v + 0.5);
    if (depth <= 0 || column < 0 || row < 0 || column >= 16 || row >= 10) continue;
    float& place = expected[static_cast<std::size_t>(row * 16 + column)];
    if (place == 0 || static_cast<float>(depth) < place) place = static_cast<float>(depth);
  }
  CHECK(depth_image(cloud.points_view(), 16, 10, small) == expected);
}

TEST_CASE("a cloud without points has no colours and an empty depth image") {
  const Image image(4, 3, 3);
  CHECK(colorize({}, image.view, camera).size() == 0);
  CHECK(depth_image({}, 2, 1, camera) == std::vector<float>{0, 0});
}

TEST_CASE("colouring refuses bad points, images and projections") {
  const Image image(4, 3, 3);
  const std::vector<float> point{0, 0, 1};
  const std::vector<float> bad{0, 0, 1, 0, std::nanf(""), 1};
  const PointsView points{point.data(), 1};
  check_refused<DataError>([&] { colorize({bad.data(), 2}, image.view, camera); }, "point 1");
  check_refused<DataError>([&] { colorize(points, {}, camera); }, "empty");
  check_refused<DataError>([&] { depth_image(points, 0, 5, camera); }, "0x5");
  check_refused<DataError>([&] { colorize(points, image.view, Projection{}); }, "singular");
  Projection infinite = camera;
  infinite[3] = std::numeric_limits<double>::infinity();
  check_refused<DataError>([&] { colorize(points, image.view, infinite); }, "finite");
  ImageView odd = image.view;
  odd.channels = 2;
  check_refused<ShapeError>([&] { colorize(points, odd, camera); }, "2 channels");
  odd = image.view;
  odd.row_stride = 11;
  check_refused<ShapeError>([&] { colorize(points, odd, camera); }, "row_stride is 11");
}

/// Boxes on a tilted, slightly rough plane, seen with z up from 1.7 m above the ground.
struct Scene {
  std::vector<float> points;
  std::vector<std::int64_t> boxes;
};

/// Height above the scene's ground is along `up`; the other axes keep their order.
Scene tilted_scene(UpAxis up) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto axis = static_cast<std::size_t>(up) % 3;
  const double sign = static_cast<std::size_t>(up) < 3 ? 1 : -1;
  Scene scene;
  for (std::int64_t i = 0; i < 2000; ++i) {
    const double x = 20 * uniform(random), y = 20 * uniform(random), noise = uniform(random);
    const bool box = i % 4 == 0;
    if (box) scene.boxes.push_back(i);
    const double height = 0.05 * x - 0.03 * y - 1.7 + (box ? 2 + 1.2 * noise : 0.05 * noise);
    std::array<double, 3> point{};
    point[axis] = sign * height;
    point[(axis + 1) % 3] = x;
    point[(axis + 2) % 3] = y;
    for (const double value : point) scene.points.push_back(static_cast<float>(value));
  }
  return scene;
}

constexpr UpAxis all_axes[] = {UpAxis::x,       UpAxis::y,       UpAxis::z,
                               UpAxis::minus_x, UpAxis::minus_y, UpAxis::minus_z};

TEST_CASE("the ground plane is found under boxes, whichever way is up") {
  for (const UpAxis up : all_axes) {
    INFO("up ", std::string(choice_name(up)));
    const Scene scene = tilted_scene(up);
    const auto ground = remove_ground_plane({scene.points.data(), scene.points.size() / 3}, up);
    CHECK(ground.kept == scene.boxes);
    const auto axis = static_cast<std::size_t>(up) % 3;
    const double sign = static_cast<std::size_t>(up) < 3 ? 1 : -1;
    CHECK(sign * ground.coefficients[axis] == doctest::Approx(0.9983).epsilon(0.002));
    CHECK(ground.coefficients[3] == doctest::Approx(1.7).epsilon(0.01));
  }
}

TEST_CASE("ground removal is repeatable") {
  const Scene scene = tilted_scene(UpAxis::z);
  const PointsView points{scene.points.data(), scene.points.size() / 3};
  CHECK(remove_ground_plane(points).coefficients == remove_ground_plane(points).coefficients);
}

TEST_CASE("a plane that leans too far is no ground, and all points are kept") {
  const Scene scene = tilted_scene(UpAxis::z);
  const PointsView points{scene.points.data(), scene.points.size() / 3};
  for (const double tilt : {0.0, 1.0}) {
    GroundPlaneConfig config;
    config.max_tilt = tilt;
    config.distance = 0.01;
    const auto ground = remove_ground_plane(points, UpAxis::x, config);
    CHECK(std::fabs(ground.coefficients[2]) < 0.1);
    CHECK(ground.kept.size() > 1900);
  }
}

TEST_CASE("points on one line have no ground plane, and fewer than three are refused") {
  const std::vector<float> line{0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0};
  const auto ground = remove_ground_plane({line.data(), 4});
  CHECK(ground.kept.size() == 4);
  CHECK(ground.coefficients == std::array<double, 4>{});
  check_refused<DataError>([&] { remove_ground_plane({line.data(), 2}); }, "2 points");
}

TEST_CASE("the height threshold keeps what is above it, whichever way is up") {
  for (const UpAxis up : all_axes) {
    const Cloud cloud = cloud_around(300);
    const auto number = static_cast<std::size_t>(up);
    std::vector<std::int64_t> expected;
    for (std::size_t i = 0; i < 300; ++i)
      if ((number < 3 ? 1 : -1) * cloud.points[3 * i + number % 3] > -1.5F)
        expected.push_back(static_cast<std::int64_t>(i));
    CHECK(above_height(cloud.points_view(), -1.5, up) == expected);
  }
  check_refused<ConfigError>([] { above_height({}, std::nan("")); }, "height");
}

/// Sums of position and colour by cube, with the order of first meeting.
struct NaiveCube {
  std::int64_t first = 0;
  double sums[6] = {0, 0, 0, 0, 0, 0};
  int count = 0;
};

std::map<std::int64_t, NaiveCube> naive_cubes(const Cloud& cloud, double size) {
  std::map<std::array<long, 3>, NaiveCube> cubes;
  for (std::size_t i = 0; i < cloud.points.size(); i += 3) {
    std::array<long, 3> key{};
    for (std::size_t c = 0; c < 3; ++c)
      key[c] = std::lround(std::floor(cloud.points[i + c] / size));
    NaiveCube& cube = cubes[key];
    if (cube.count++ == 0) cube.first = static_cast<std::int64_t>(i / 3);
    for (std::size_t c = 0; c < 3; ++c) {
      cube.sums[c] += cloud.points[i + c];
      cube.sums[3 + c] += cloud.colors[i + c];
    }
  }
  std::map<std::int64_t, NaiveCube> by_first;
  for (const auto& [key, cube] : cubes) by_first[cube.first] = cube;
  return by_first;
}

TEST_CASE("voxels hold the mean point and colour of a naive grid") {
  Cloud cloud = testing::random_cloud(3000);
  for (float& value : cloud.points) value -= 3;  // cubes on both sides of zero
  for (const double size : {0.3, 1.0, 7.5, 1000.0}) {
    const auto result = voxel_downsample(cloud.points_view(), cloud.colors_view(), size);
    const auto expected = naive_cubes(cloud, size);
    REQUIRE(result.size() == expected.size());
    std::size_t i = 0;
    for (const auto& [first, cube] : expected) {
      CHECK(result.indices[i] == first);
      for (std::size_t c = 0; c < 3; ++c) {
        CHECK(result.points[3 * i + c] == doctest::Approx(cube.sums[c] / cube.count));
        CHECK(result.colors[3 * i + c] == std::lround(cube.sums[3 + c] / cube.count));
      }
      ++i;
    }
  }
}

TEST_CASE("voxels need no colours and no points") {
  const Cloud cloud = testing::random_cloud(100);
  const auto plain = voxel_downsample(cloud.points_view(), {}, 2.0);
  CHECK(plain.colors.empty());
  CHECK(plain.points == voxel_downsample(cloud.points_view(), cloud.colors_view(), 2.0).points);
  CHECK(voxel_downsample({}, {}, 2.0).size() == 0);
}

TEST_CASE("voxels refuse sizes that make no grid, other lengths and NaN") {
  Cloud cloud = testing::random_cloud(10);
  const auto downsample = [&](double size) {
    return voxel_downsample(cloud.points_view(), cloud.colors_view(), size);
  };
  check_refused<ConfigError>([&] { downsample(0); }, "voxel size");
  check_refused<ConfigError>([&] { downsample(std::nan("")); }, "voxel size");
  check_refused<DataError>([&] { downsample(1e-7); }, "2^21");
  check_refused<DataError>([&] { downsample(1e-320); }, "2^21");
  check_refused<ShapeError>(
      [&] { voxel_downsample(cloud.points_view(), {cloud.colors.data(), 9}, 1); }, "9 rows");
  cloud.points[4] = std::nanf("");
  check_refused<DataError>([&] { downsample(1); }, "point 1");
}

TEST_CASE("points with NaN or infinity are dropped") {
  Cloud cloud = testing::random_cloud(5);
  cloud.points[3] = std::nanf("");
  cloud.points[11] = -std::numeric_limits<float>::infinity();
  CHECK(drop_invalid(cloud.points_view()) == std::vector<std::int64_t>{0, 2, 4});
  CHECK(drop_invalid({}).empty());
}

}  // namespace
}  // namespace fusionslam
