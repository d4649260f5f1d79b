// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "matrix_kernel.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t lanes = 16;  // partial sums; how many is part of the result

/// The dot products of `Rows` rows with a vector, side by side, so that one addition need not wait
/// for the other.
template <int Rows, class Scalar>
FUSIONSLAM_INLINE void dot(const float* matrix, const Scalar* vector, std::size_t size,
                           Scalar* result) {
  Scalar partial[Rows][lanes] = {};
  std::size_t i = 0;
  for (; i + lanes <= size; i += lanes)
    for (std::size_t row = 0; row < Rows; ++row)
      for (std::size_t lane = 0; lane < lanes; ++lane)
        partial[row][lane] += static_cast<Scalar>(matrix[row * size + i + lane]) * vector[i + lane];
  for (std::size_t row = 0; row < Rows; ++row) {
    for (std::size_t width = lanes / 2; width > 0; width /= 2)  // halves onto halves
      for (std::size_t lane = 0; lane < width; ++lane)
        partial[row][lane] += partial[row][lane + width];
    Scalar sum = partial[row][0];
    for (std::size_t k = i; k < size; ++k)
      sum += static_cast<Scalar>(matrix[row * size + k]) * vector[k];
    result[row] = sum;
  }
}

template <class Scalar>
FUSIONSLAM_INLINE void multiply(const float* matrix, int rows, int columns, const Scalar* right,
                                Scalar* result) {
  const auto size = static_cast<std::size_t>(columns);
  int row = 0;
  for (; row + 4 <= rows; row += 4)
    dot<4>(matrix + static_cast<std::size_t>(row) * size, right, size, result + row);
  for (; row < rows; ++row)
    dot<1>(matrix + static_cast<std::size_t>(row) * size, right, size, result + row);
}

/// Four rows at a time, so that the result is read and written less often.
template <class Scalar>
FUSIONSLAM_INLINE void multiply_transposed(const float* matrix, int rows, int columns,
                                           const Scalar* left, Scalar* __restrict result) {
  const auto size = static_cast<std::size_t>(columns);
  for (std::size_t i = 0; i < size; ++i) result[i] = 0;
  int row = 0;
  for (; row + 4 <= rows; row += 4) {
    const float* a = matrix + static_cast<std::size_t>(row) * size;
    const float *b = a + size, *c = b + size, *d = c + size;
    const Scalar s = left[row], t = left[row + 1], u = left[row + 2], v = left[row + 3];
    for (std::size_t i = 0; i < size; ++i)
      result[i] += (static_cast<Scalar>(a[i]) * s + static_cast<Scalar>(b[i]) * t) +
                   (static_cast<Scalar>(c[i]) * u + static_cast<Scalar>(d[i]) * v);
  }
  for (; row < rows; ++row) {
    const float* a = matrix + static_cast<std::size_t>(row) * size;
    for (std::size_t i = 0; i < size; ++i) result[i] += static_cast<Scalar>(a[i]) * left[row];
  }
}

FUSIONSLAM_INLINE void to_float(const double* values, std::size_t size, float* __restrict result) {
  for (std::size_t i = 0; i < size; ++i) result[i] = static_cast<float>(values[i]);
}

FUSIONSLAM_INLINE void to_roots(const double* values, std::size_t size, float* __restrict result) {
  for (std::size_t i = 0; i < size; ++i) result[i] = __builtin_sqrtf(static_cast<float>(values[i]));
}

}  // namespace

MatrixKernel matrix_kernel(SimdLevel level) {
  return {{compiled_for<multiply<float>>(level), compiled_for<multiply_transposed<float>>(level)},
          {compiled_for<multiply<double>>(level), compiled_for<multiply_transposed<double>>(level)},
          compiled_for<to_float>(level),
          compiled_for<to_roots>(level)};
}

}  // namespace fusionslam::detail
