// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "singular_vectors.hpp"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>

namespace fusionslam::detail {

std::vector<float> first_singular_vectors(const Signature& signature) {
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::Map<const Matrix> a(signature.values.data(), signature.rows, signature.columns);
  // The left vectors of A are the eigenvectors of the small matrix A A^T.
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(a * a.transpose());
  Eigen::VectorXd left = solver.eigenvectors().col(signature.rows - 1);
  if (left.sum() < 0) left = -left;
  const Eigen::VectorXd right = (a.transpose() * left).normalized();

  std::vector<float> result(static_cast<std::size_t>(signature.rows + signature.columns));
  Eigen::Map<Eigen::VectorXf> joined(result.data(), signature.rows + signature.columns);
  joined << left.cast<float>(), right.cast<float>();
  return result;
}

}  // namespace fusionslam::detail
