// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "moments_kernel.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t lanes = 16;  // partial sums; how many is part of the result

/// Fills the block up to whole lanes with a point that adds nothing.
FUSIONSLAM_INLINE std::size_t pad(CoordinateBlock& b, std::size_t count, const float* filler) {
  std::size_t i = count;
  for (; i % lanes != 0; ++i) {
    b.x[i] = filler[0];
    b.y[i] = filler[1];
    b.z[i] = filler[2];
  }
  return i;
}

FUSIONSLAM_INLINE double total(const double* partial) {
  double sum = 0;
  for (std::size_t lane = 0; lane < lanes; ++lane) sum += partial[lane];
  return sum;
}

FUSIONSLAM_INLINE void sum_points(RawPoints points, double* sums) {
  const float zero[3] = {0, 0, 0};
  double x[lanes] = {}, y[lanes] = {}, z[lanes] = {};
  CoordinateBlock b;
  for (std::size_t begin = 0; begin < points.size; begin += point_block) {
    const std::size_t end = pad(b, load(points, begin, b), zero);
    for (std::size_t i = 0; i < end; i += lanes) {
      for (std::size_t lane = 0; lane < lanes; ++lane)
        x[lane] += static_cast<double>(b.x[i + lane]);
      for (std::size_t lane = 0; lane < lanes; ++lane)
        y[lane] += static_cast<double>(b.y[i + lane]);
      for (std::size_t lane = 0; lane < lanes; ++lane)
        z[lane] += static_cast<double>(b.z[i + lane]);
    }
  }
  sums[0] += total(x);
  sums[1] += total(y);
  sums[2] += total(z);
}

FUSIONSLAM_INLINE void scatter_points(RawPoints points, const double* mean, double* sums) {
  double partial[6][lanes] = {};
  double x[lanes], y[lanes], z[lanes];
  CoordinateBlock b;
  for (std::size_t begin = 0; begin < points.size; begin += point_block) {
    const std::size_t count = load(points, begin, b);
    for (std::size_t i = 0; i < count; i += lanes) {
      const std::size_t full = count - i < lanes ? count - i : lanes;
      for (std::size_t lane = 0; lane < lanes; ++lane) {
        const bool inside = lane < full;
        x[lane] = inside ? static_cast<double>(b.x[i + lane]) - mean[0] : 0;
        y[lane] = inside ? static_cast<double>(b.y[i + lane]) - mean[1] : 0;
        z[lane] = inside ? static_cast<double>(b.z[i + lane]) - mean[2] : 0;
      }
      for (std::size_t lane = 0; lane < lanes; ++lane) {
        partial[0][lane] += x[lane] * x[lane];
        partial[1][lane] += y[lane] * y[lane];
        partial[2][lane] += z[lane] * z[lane];
        partial[3][lane] += x[lane] * y[lane];
        partial[4][lane] += x[lane] * z[lane];
        partial[5][lane] += y[lane] * z[lane];
      }
    }
  }
  for (std::size_t i = 0; i < 6; ++i) sums[i] += total(partial[i]);
}

FUSIONSLAM_INLINE void transform_block(const CoordinateBlock& b, std::size_t begin, std::size_t end,
                                       const KernelFrame& f, double* x, double* y, double* z) {
  for (std::size_t i = begin; i < end; ++i) {
    const double dx = static_cast<double>(b.x[i]) - f.origin[0];
    const double dy = static_cast<double>(b.y[i]) - f.origin[1];
    const double dz = static_cast<double>(b.z[i]) - f.origin[2];
    x[i] = f.rows[0][0] * dx + f.rows[0][1] * dy + f.rows[0][2] * dz;
    y[i] = f.rows[1][0] * dx + f.rows[1][1] * dy + f.rows[1][2] * dz;
    z[i] = f.rows[2][0] * dx + f.rows[2][1] * dy + f.rows[2][2] * dz;
  }
}

FUSIONSLAM_INLINE double largest_of(RawPoints points, const KernelFrame& frame, double largest) {
  double x[point_block], y[point_block], z[point_block];
  double best[lanes];
  for (std::size_t lane = 0; lane < lanes; ++lane) best[lane] = largest;
  CoordinateBlock b;
  for (std::size_t begin = 0; begin < points.size; begin += point_block) {
    const std::size_t count = load(points, begin, b);
    const float first[3] = {b.x[0], b.y[0], b.z[0]};
    const std::size_t end = pad(b, count, first);
    transform_block(b, 0, end, frame, x, y, z);
    for (std::size_t i = 0; i < end; i += lanes)
      for (std::size_t lane = 0; lane < lanes; ++lane) {
        const std::size_t k = i + lane;
        const double squared = x[k] * x[k] + y[k] * y[k] + z[k] * z[k];
        best[lane] = best[lane] > squared ? best[lane] : squared;
      }
  }
  for (std::size_t lane = 0; lane < lanes; ++lane)
    largest = best[lane] > largest ? best[lane] : largest;
  return largest;
}

FUSIONSLAM_INLINE void transform_points(RawPoints points, const KernelFrame& frame, float* x,
                                        float* y, float* z) {
  double qx[point_block], qy[point_block], qz[point_block];
  CoordinateBlock b;
  for (std::size_t begin = 0; begin < points.size; begin += point_block) {
    const std::size_t count = load(points, begin, b);
    transform_block(b, 0, count, frame, qx, qy, qz);
    for (std::size_t i = 0; i < count; ++i) x[begin + i] = static_cast<float>(qx[i]);
    for (std::size_t i = 0; i < count; ++i) y[begin + i] = static_cast<float>(qy[i]);
    for (std::size_t i = 0; i < count; ++i) z[begin + i] = static_cast<float>(qz[i]);
  }
}

}  // namespace

MomentsKernel moments_kernel(SimdLevel level) {
  return {compiled_for<sum_points>(level), compiled_for<scatter_points>(level),
          compiled_for<largest_of>(level), compiled_for<transform_points>(level)};
}

}  // namespace fusionslam::detail
