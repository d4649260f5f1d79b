// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "fusionslam/simd.hpp"

namespace fusionslam::detail {

/// Counts which of `count` points lie within a radius of `query`. The points are `dimensions`
/// columns, `stride` doubles apart; a point counts if its squared distance is <= `bound`. Squares
/// are added in the order of the dimensions, so every level gives the same answer.
using CountWithin = std::size_t(const double* columns, std::size_t stride, std::size_t count,
                                const double* query, double bound);

/// The kernel for 3 or 6 dimensions.
CountWithin* count_within(int dimensions, SimdLevel level);

}  // namespace fusionslam::detail
