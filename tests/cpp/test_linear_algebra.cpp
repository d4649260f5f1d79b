// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Moments and singular vectors against plain loops and Eigen's SVD.
#include <doctest/doctest.h>

#include <Eigen/SVD>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "descriptors/matrix_kernel.hpp"
#include "descriptors/moments_kernel.hpp"
#include "descriptors/singular_vectors.hpp"
#include "levels.hpp"

namespace fusionslam::detail {
namespace {

using FloatMatrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

SingularVectors vectors_of(const FloatMatrix& matrix) {
  return singular_vectors(
      {matrix.data(), static_cast<int>(matrix.rows()), static_cast<int>(matrix.cols())});
}

FloatMatrix random_matrix(int rows, int columns, unsigned seed) {
  std::mt19937 random(seed);
  std::gamma_distribution<float> gamma(0.3F);
  FloatMatrix matrix(rows, columns);
  for (Eigen::Index i = 0; i < matrix.size(); ++i) matrix.data()[i] = gamma(random);
  return matrix;
}

double error_against_svd(const FloatMatrix& matrix, const SingularVectors& given) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(matrix.cast<double>(),
                                              Eigen::ComputeThinU | Eigen::ComputeThinV);
  Eigen::VectorXd expected(matrix.rows() + matrix.cols());
  expected << svd.matrixU().col(0), svd.matrixV().col(0);
  if (expected.sum() < 0) expected = -expected;
  const Eigen::Map<const Eigen::VectorXf> joined(given.joined.data(), expected.size());
  return (joined.cast<double>() - expected).norm();
}

TEST_CASE("singular vectors are those of Eigen's SVD") {
  for (const auto& [rows, columns] :
       {std::pair{64, 512}, {64, 128}, {1, 7}, {3, 1}, {2, 9}, {5, 33}}) {
    INFO(rows, " x ", columns);
    const FloatMatrix matrix = random_matrix(rows, columns, 3);
    const SingularVectors given = vectors_of(matrix);
    CHECK(given.fell_back == (rows < 3 || columns < 3));  // too small to look further
    CHECK(error_against_svd(matrix, given) < 2e-7);
  }
}

TEST_CASE("close singular values reach the fall-back, which is as precise") {
  FloatMatrix matrix = FloatMatrix::Zero(64, 512);  // two blocks, joined weakly
  matrix.topLeftCorner(32, 256) = random_matrix(32, 256, 1);
  matrix.bottomRightCorner(32, 256) = matrix.topLeftCorner(32, 256) * 1.001F;
  matrix(0, 511) = 0.01F;
  const SingularVectors given = vectors_of(matrix);
  CHECK(given.fell_back);
  CHECK(error_against_svd(matrix, given) < 2e-7);
}

TEST_CASE("equal singular values give non-negative vectors that follow the row sums") {
  FloatMatrix matrix = FloatMatrix::Zero(4, 8);
  matrix.topLeftCorner(2, 4).setConstant(2);
  matrix.bottomRightCorner(2, 4).setConstant(2);
  for (const float value : vectors_of(matrix).joined) CHECK(value >= 0);
  CHECK(vectors_of(matrix).joined[0] == doctest::Approx(0.5));
  CHECK(vectors_of(matrix).joined[3] == doctest::Approx(0.5));
}

TEST_CASE("a matrix of rank one, and entries beyond float's squares, are no special case") {
  for (const float value : {3.0F, 1e-23F, 1e-40F, 1e30F})
    CHECK(error_against_svd(FloatMatrix::Constant(6, 9, value),
                            vectors_of(FloatMatrix::Constant(6, 9, value))) < 2e-7);
  for (const float scale : {1e-23F, 1e25F}) {
    const FloatMatrix matrix = random_matrix(20, 50, 8) * scale;
    CHECK(error_against_svd(matrix, vectors_of(matrix)) < 2e-7);
  }
}

TEST_CASE("blocks that differ slightly are told apart down to the rounding of floats") {
  FloatMatrix matrix = FloatMatrix::Zero(4, 8);
  matrix.topLeftCorner(2, 4).setConstant(2);
  matrix.bottomRightCorner(2, 4).setConstant(2.00001F);
  CHECK(error_against_svd(matrix, vectors_of(matrix)) < 2e-7);
}

TEST_CASE("all levels give the same products and roots") {
  const FloatMatrix matrix = random_matrix(13, 197, 5);
  const Eigen::VectorXd left = Eigen::VectorXd::LinSpaced(13, -1, 2);
  const Eigen::VectorXd right = Eigen::VectorXd::LinSpaced(197, -3, 1);
  const Eigen::VectorXd values = matrix.row(3).cast<double>();
  std::vector<float> roots(197), first_roots;
  Eigen::VectorXd times(13), transposed(197), first_times, first_transposed;
  for (const SimdLevel level : simd_levels()) {
    const MatrixKernel kernel = matrix_kernel(level);
    kernel.in_double.times(matrix.data(), 13, 197, right.data(), times.data());
    kernel.in_double.transposed_times(matrix.data(), 13, 197, left.data(), transposed.data());
    kernel.square_roots(values.data(), roots.size(), roots.data());
    CHECK((times - matrix.cast<double>() * right).norm() < 1e-10);
    CHECK((transposed - matrix.cast<double>().transpose() * left).norm() < 1e-10);
    if (level == SimdLevel::baseline) {
      first_times = times;
      first_transposed = transposed;
      first_roots = roots;
    }
    CHECK(times == first_times);
    CHECK(transposed == first_transposed);
    CHECK(roots == first_roots);
  }
}

std::vector<float> random_points(std::size_t size, std::size_t stride) {
  std::mt19937 random(7);
  std::normal_distribution<float> normal(50, 10);
  std::vector<float> points(size * stride + 3);
  for (float& value : points) value = normal(random);
  return points;
}

TEST_CASE("moments are those of plain sums, on all levels alike, for any stride and size") {
  const double mean[3] = {50, 49, 51};
  for (const std::size_t stride : {3UL, 4UL, 8UL})
    for (const std::size_t size : {0UL, 1UL, 15UL, 16UL, 255UL, 256UL, 257UL, 3000UL}) {
      const auto data = random_points(size, stride);
      const RawPoints points{data.data() + 1, stride, size};  // not aligned
      double expected[9] = {};
      for (std::size_t i = 0; i < size; ++i) {
        const float* p = points.data + i * stride;
        const double d[3] = {p[0] - mean[0], p[1] - mean[1], p[2] - mean[2]};
        for (int k = 0; k < 3; ++k) expected[k] += p[k];
        const double products[6] = {d[0] * d[0], d[1] * d[1], d[2] * d[2],
                                    d[0] * d[1], d[0] * d[2], d[1] * d[2]};
        for (int k = 0; k < 6; ++k) expected[3 + k] += products[k];
      }
      std::vector<double> first;
      for (const SimdLevel level : simd_levels()) {
        INFO("stride ", stride, " size ", size, " ", choice_name(level));
        std::vector<double> sums(9);
        moments_kernel(level).sum(points, sums.data());
        moments_kernel(level).scatter(points, mean, sums.data() + 3);
        for (std::size_t k = 0; k < 9; ++k) CHECK(sums[k] == doctest::Approx(expected[k]));
        if (first.empty()) first = sums;
        CHECK(sums == first);
      }
    }
}

TEST_CASE("one value that is not finite shows in the sums") {
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()})
    for (const SimdLevel level : simd_levels()) {
      auto data = random_points(1000, 3);
      data[3 * 777] = bad;
      data[3 * 778] = -bad;
      double sums[3] = {};
      moments_kernel(level).sum({data.data(), 3, 1000}, sums);
      CHECK_FALSE(std::isfinite(sums[0]));
    }
}

TEST_CASE("the farthest point and moved points are those of plain loops") {
  const KernelFrame frame{{50, 50, 50}, {{0.6, 0.8, 0}, {-0.8, 0.6, 0}, {0, 0, 1}}};
  const auto data = random_points(1001, 3);
  double farthest = 0;
  for (std::size_t i = 0; i < 1001; ++i)
    farthest =
        std::max(farthest, std::pow(data[3 * i] - 50, 2) + std::pow(data[3 * i + 1] - 50, 2) +
                               std::pow(data[3 * i + 2] - 50, 2));
  for (const SimdLevel level : simd_levels()) {
    const auto kernel = moments_kernel(level);
    CHECK(kernel.largest_squared({data.data(), 3, 1001}, frame, 0) == doctest::Approx(farthest));
    std::vector<float> x(1001), y(1001), z(1001);
    kernel.transform({data.data(), 3, 1001}, frame, x.data(), y.data(), z.data());
    CHECK(x[1000] == doctest::Approx(0.6 * (data[3000] - 50) + 0.8 * (data[3001] - 50)));
    CHECK(z[1000] == doctest::Approx(data[3002] - 50));
  }
}

}  // namespace
}  // namespace fusionslam::detail
