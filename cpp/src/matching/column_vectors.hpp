// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Vectors of eight floats, for the kernels of rows of columns only.
#pragma once

#include <cstring>

#include "column_kernel.hpp"

namespace fusionslam::detail {
namespace {

typedef float ColumnVector __attribute__((vector_size(column_lanes * sizeof(float)), may_alias));
typedef ColumnVector UnalignedVector __attribute__((aligned(4)));

// By reference: a vector is returned in other registers where there are wider ones.
FUSIONSLAM_INLINE const UnalignedVector& load(const float* values) {
  return *reinterpret_cast<const UnalignedVector*>(values);
}

FUSIONSLAM_INLINE void store(const ColumnVector& vector, float* values) {
  *reinterpret_cast<UnalignedVector*>(values) = vector;
}

FUSIONSLAM_INLINE float sum_of(const ColumnVector& vector) {
  float sums[column_lanes];
  std::memcpy(sums, &vector, sizeof(sums));
  for (std::size_t half = column_lanes / 2; half > 0; half /= 2)
    for (std::size_t lane = 0; lane < half; ++lane) sums[lane] += sums[lane + half];
  return sums[0];
}

}  // namespace
}  // namespace fusionslam::detail
