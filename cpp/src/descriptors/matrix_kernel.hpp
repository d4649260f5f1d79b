// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <type_traits>

#include "../detail/simd.hpp"

namespace fusionslam::detail {

/// Products of a row-major float matrix with vectors, computed in the type of the vectors.
template <class Scalar>
struct MatrixProducts {
  /// result[rows] = A right[columns]
  void (*times)(const float* matrix, int rows, int columns, const Scalar* right, Scalar* result);
  /// result[columns] = A^T left[rows]
  void (*transposed_times)(const float* matrix, int rows, int columns, const Scalar* left,
                           Scalar* result);
};

/// All levels add in the same order and give the same bits.
struct MatrixKernel {
  MatrixProducts<float> in_float;
  MatrixProducts<double> in_double;
  /// Values as float, and their square roots.
  void (*convert)(const double* values, std::size_t size, float* result);
  void (*square_roots)(const double* values, std::size_t size, float* result);

  template <class Scalar>
  const MatrixProducts<Scalar>& products() const {
    if constexpr (std::is_same_v<Scalar, float>)
      return in_float;
    else
      return in_double;
  }
};

MatrixKernel matrix_kernel(SimdLevel level);

}  // namespace fusionslam::detail
