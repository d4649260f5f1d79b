// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace fusionslam::detail {

/// Row-major matrix of entries >= 0.
struct MatrixView {
  const float* data;
  int rows;
  int columns;
};

struct SingularVectors {
  std::vector<float> joined;  ///< left (rows), then right (columns), each of length 1
  int iterations = 0;         ///< products with A A^T before a fall-back
  bool fell_back = false;     ///< to the eigenvectors of the Gram matrix
};

/// First left and right singular vectors of a matrix of non-negative entries. Both can be chosen
/// non-negative (Perron and Frobenius) and are. Where the two largest singular values are equal
/// but for the rounding of the entries,
/// the left one is that of their vectors' space which is nearest to the row sums.
///
/// Lanczos's method and the power method until the estimated error is below 1e-7, about what a
/// vector of floats is rounded to; where that would take long because the two largest singular
/// values are close, the eigenvectors of A A^T in double precision.
SingularVectors singular_vectors(MatrixView matrix);

}  // namespace fusionslam::detail
