// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The hot loops of the sheet of pose cells. No buffer overlaps another one.
#pragma once

#include <cstddef>

#include "fusionslam/simd.hpp"

namespace fusionslam::detail {

/// Weights of a symmetric window, the middle one first.
struct Window {
  static constexpr int reach = 3;
  double weights[reach + 1];
};

struct SheetKernels {
  /// out[i] = sum of weights[|k|] in[i + k stride] over |k| <= 3, of which `in` is the middle; and
  /// over |k| <= 2.
  void (*blur3)(const double* in, std::size_t stride, std::size_t count, const Window& window,
                double* out);
  void (*blur2)(const double* in, std::size_t stride, std::size_t count, const Window& window,
                double* out);
  /// out = max(excited - inhibited - taken, 0); returns its sum.
  double (*inhibit)(const double* excited, const double* inhibited, double taken, std::size_t count,
                    double* out);
  void (*scale)(double factor, std::size_t count, double* cells);
  /// out[i] = of_a a[i] + of_b b[i]
  void (*mix)(const double* a, double of_a, const double* b, double of_b, std::size_t count,
              double* out);
  double (*largest)(const double* cells, std::size_t count);
};

SheetKernels sheet_kernels(SimdLevel level);

}  // namespace fusionslam::detail
