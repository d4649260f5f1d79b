// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "singular_vectors.hpp"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <string>

#include "fusionslam/descriptors.hpp"
#include "fusionslam/errors.hpp"
#include "matrix_kernel.hpp"

namespace fusionslam {
namespace detail {
namespace {

using Vector = Eigen::VectorXd;

/// A A^T x, normalised; Scalar is the precision of the products.
template <class Scalar>
Vector step(MatrixView a, const MatrixKernel& kernel, const Vector& left) {
  using ScalarVector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
  const auto& products = kernel.products<Scalar>();
  const ScalarVector from = left.cast<Scalar>();
  ScalarVector right(a.columns), next(a.rows);
  products.transposed_times(a.data, a.rows, a.columns, from.data(), right.data());
  right.normalize();
  products.times(a.data, a.rows, a.columns, right.data(), next.data());
  return next.template cast<double>().normalized();
}

/// How far a power iteration has come. Changes shrink like a geometric series, so what is still to
/// come is the sum of its rest.
class Progress {
 public:
  void record(double change) {
    ratio_ = std::min(change / last_, 0.999);
    last_ = change;
  }
  double last() const { return last_; }
  /// Iterations until the error is below the tolerance; not above 0 once it is.
  double missing(double tolerance) const {
    if (last_ < 1e-15) return 0;
    return std::log(tolerance * (1 - ratio_) / last_) / std::log(ratio_) - 1;
  }

 private:
  double last_ = 1;
  double ratio_ = 0.999;
};

/// Turns `left` into the first left singular vector; false once that is seen to take too long.
/// The first steps, which need not be precise, are taken in float.
bool power_method(MatrixView a, Vector& left, int& iterations) {
  constexpr int most = 24;
  constexpr double float_is_enough = 1e-5;
  constexpr double tolerance = 4e-9;  // well below what the result, as float, is rounded to
  const MatrixKernel kernel = matrix_kernel(simd_level());
  Progress progress;
  for (iterations = 1; iterations <= most; ++iterations) {
    const bool coarse = progress.last() > float_is_enough;
    const Vector next = coarse ? step<float>(a, kernel, left) : step<double>(a, kernel, left);
    progress.record((next - left).norm());
    left = next;
    if (!coarse && progress.missing(tolerance) <= 0) return true;
    if (iterations > 4 && iterations + progress.missing(tolerance) > most) return false;
  }
  return false;
}

/// The projection of `start` onto the eigenvectors of A A^T with the largest eigenvalue.
Vector gram_vector(MatrixView matrix, const Vector& start) {
  using Matrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::MatrixXd a =
      Eigen::Map<const Matrix>(matrix.data, matrix.rows, matrix.columns).cast<double>();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(a * a.transpose());
  const Vector& values = solver.eigenvalues();
  const Eigen::Index last = matrix.rows - 1;
  Vector result = Vector::Zero(matrix.rows);
  for (Eigen::Index i = last; i >= 0 && values[i] >= values[last] * (1 - 1e-12); --i)
    result += solver.eigenvectors().col(i).dot(start) * solver.eigenvectors().col(i);
  return result.normalized();
}

}  // namespace

SingularVectors singular_vectors(MatrixView matrix) {
  const auto products = matrix_kernel(simd_level()).in_double;
  Vector start(matrix.rows), right = Vector::Ones(matrix.columns);
  products.times(matrix.data, matrix.rows, matrix.columns, right.data(), start.data());
  start.normalize();
  Vector left = start;
  SingularVectors result;
  result.fell_back = !power_method(matrix, left, result.iterations);
  if (result.fell_back) left = gram_vector(matrix, start);
  products.transposed_times(matrix.data, matrix.rows, matrix.columns, left.data(), right.data());
  right.normalize();
  result.joined.resize(static_cast<std::size_t>(matrix.rows + matrix.columns));
  Eigen::Map<Eigen::VectorXf>(result.joined.data(), matrix.rows) = left.cast<float>();
  Eigen::Map<Eigen::VectorXf>(result.joined.data() + matrix.rows, matrix.columns) =
      right.cast<float>();
  return result;
}

}  // namespace detail

std::vector<float> first_singular_vectors(std::span<const float> matrix, int rows, int columns) {
  if (rows < 1 || columns < 1 ||
      matrix.size() != static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns))
    throw ShapeError(std::to_string(matrix.size()) + " values are no matrix of " +
                     std::to_string(rows) + " x " + std::to_string(columns));
  float largest = 0;
  for (std::size_t i = 0; i < matrix.size(); ++i) {
    if (!(matrix[i] >= 0) || std::isinf(matrix[i]))
      throw DataError("entry " + std::to_string(i) + " of the matrix is " +
                      std::to_string(matrix[i]) + ", expected a finite number >= 0");
    largest = std::max(largest, matrix[i]);
  }
  if (largest == 0) throw DataError("the matrix is zero, it has no first singular vectors");
  return detail::singular_vectors({matrix.data(), rows, columns}).joined;
}

}  // namespace fusionslam
