// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "singular_vectors.hpp"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <string>

#include "../detail/interrupt.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/errors.hpp"
#include "matrix_kernel.hpp"

namespace fusionslam {
namespace detail {
namespace {

using Vector = Eigen::VectorXd;

/// A A^T left; Scalar is the precision of the products.
template <class Scalar>
Vector step(MatrixView a, const MatrixKernel& kernel, const Vector& left) {
  using ScalarVector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
  const auto& products = kernel.products<Scalar>();
  const ScalarVector& from = left.cast<Scalar>();
  ScalarVector right(a.columns), next(a.rows);
  products.transposed_times(a.data, a.rows, a.columns, from.data(), right.data());
  products.times(a.data, a.rows, a.columns, right.data(), next.data());
  return next.template cast<double>();
}

/// Estimate of the largest eigenvalue of A A^T and its vector in a Krylov space.
struct Ritz {
  Vector vector;
  double error;  ///< estimated, of the vector
  double ratio;  ///< of the second largest eigenvalue to the largest
};

/// From the Lanczos basis, the tridiagonal matrix in it, and the length of what lies outside.
Ritz ritz(const Eigen::MatrixXd& basis, const std::vector<double>& diagonal,
          const std::vector<double>& off_diagonal, double outside) {
  const auto size = static_cast<Eigen::Index>(diagonal.size());
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver;
  solver.computeFromTridiagonal(Eigen::Map<const Vector>(diagonal.data(), size),
                                Eigen::Map<const Vector>(off_diagonal.data(), size - 1));
  const Vector& values = solver.eigenvalues();
  const Vector weights = solver.eigenvectors().col(size - 1);
  const double second = size > 1 ? values[size - 2] : 0;
  const double residual = outside * std::fabs(weights[size - 1]);
  return {basis.leftCols(size) * weights, residual / (values[size - 1] - second),
          second / values[size - 1]};
}

/// Lanczos's method with products in float, up to their rounding; false if it takes too long or
/// leaves float's range.
bool lanczos(MatrixView a, const MatrixKernel& kernel, Vector& left, double& ratio, int& steps) {
  constexpr int most = 16;
  constexpr double rounding = 1e-6;
  constexpr double smallest = 1e-20;  // below, products would leave float's range
  Eigen::MatrixXd basis(a.rows, most);
  std::vector<double> diagonal, off_diagonal;
  basis.col(0) = left;
  for (steps = 1; steps <= most; ++steps) {
    check_interrupt();
    Vector next = step<float>(a, kernel, basis.col(steps - 1));
    const double length = next.norm();
    diagonal.push_back(basis.col(steps - 1).dot(next));
    for (int pass = 0; pass < 2; ++pass)  // twice is enough (Parlett)
      next -= basis.leftCols(steps) * (basis.leftCols(steps).transpose() * next);
    const double outside = next.norm();
    if (!std::isfinite(outside) || !(diagonal.front() > smallest)) return false;
    const bool closed = outside <= rounding * length;
    if (closed && steps < 3) return false;  // nothing is known of the second singular value
    if (steps >= 3) {
      const Ritz found = ritz(basis, diagonal, off_diagonal, outside);
      left = found.vector;
      ratio = found.ratio;
      if (closed || found.error < rounding) return true;
    }
    if (steps == a.rows || steps == most) return false;
    off_diagonal.push_back(outside);
    basis.col(steps) = next / outside;
  }
  return false;
}

/// Turns `left` into the first left singular vector; false if the two largest singular values are
/// so close that it would take long. Lanczos's method in float, then the power method in double
/// until the remaining change, a geometric series, is below the tolerance.
bool iterate(MatrixView a, Vector& left, int& iterations) {
  constexpr int most = 8;
  constexpr double too_close = 0.9;
  constexpr double tolerance = 1e-7;  // of a vector of length 1; about float's rounding
  const MatrixKernel kernel = matrix_kernel(simd_level());
  double ratio = 1;
  if (!lanczos(a, kernel, left, ratio, iterations) || !(ratio < too_close)) return false;
  for (int i = 0; i < most; ++i, ++iterations) {
    check_interrupt();
    Vector next = step<double>(a, kernel, left).normalized();
    if (next.dot(left) < 0) next = -next;
    const double change = (next - left).norm();
    left = next;
    if (change * ratio <= tolerance * (1 - ratio)) return true;
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
  constexpr double same = 2e-6;  // what the entries' rounding to float can make of equal ones
  Vector result = Vector::Zero(matrix.rows);
  for (Eigen::Index i = last; i >= 0 && values[i] >= values[last] * (1 - same); --i)
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
  result.fell_back = !iterate(matrix, left, result.iterations);
  if (result.fell_back) left = gram_vector(matrix, start);
  products.transposed_times(matrix.data, matrix.rows, matrix.columns, left.data(), right.data());
  if (left.sum() < 0) {
    left = -left;
    right = -right;
  }
  right.normalize();
  result.joined.resize(static_cast<std::size_t>(matrix.rows + matrix.columns));
  Eigen::Map<Eigen::VectorXf>(result.joined.data(), matrix.rows) = left.cast<float>();
  Eigen::Map<Eigen::VectorXf>(result.joined.data() + matrix.rows, matrix.columns) =
      right.cast<float>();
  return result;
}

}  // namespace detail

namespace {

/// Bits of floats >= 0 are ordered like the floats, and all others lie above them.
void check_entries(std::span<const float> matrix) {
  std::uint32_t bad = 0, any = 0;
  for (const float entry : matrix) {
    const auto bits = std::bit_cast<std::uint32_t>(entry + 0.0F);  // -0 becomes 0
    bad |= static_cast<std::uint32_t>(bits > 0x7f7fffffU);
    any |= bits;
  }
  if (any == 0 && bad == 0) throw DataError("the matrix is zero, it has no first singular vectors");
  if (bad == 0) return;
  for (std::size_t i = 0; i < matrix.size(); ++i)
    if (!(matrix[i] >= 0) || std::isinf(matrix[i]))
      throw DataError("entry " + std::to_string(i) + " of the matrix is " +
                      std::to_string(matrix[i]) + ", expected a finite number >= 0");
}

}  // namespace

std::vector<float> first_singular_vectors(std::span<const float> matrix, int rows, int columns) {
  if (rows < 1 || columns < 1 ||
      matrix.size() != static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns))
    throw ShapeError(std::to_string(matrix.size()) + " values are no matrix of " +
                     std::to_string(rows) + " x " + std::to_string(columns));
  check_entries(matrix);
  return detail::singular_vectors({matrix.data(), rows, columns}).joined;
}

}  // namespace fusionslam
