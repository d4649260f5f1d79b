// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "../detail/point_block.hpp"

namespace fusionslam::detail {

/// The four sides of what an image sees: a point is inside where a x + b y + c z + d >= 0.
struct Frustum {
  float sides[4][4];
};

/// Lists which of at most point_block points may lie inside; returns how many. Rounding is allowed
/// for: no point inside is missed, and hardly any other listed. `largest` becomes the largest bit
/// pattern of a coordinate's magnitude; from 0x7f800000 on, one is not finite. All levels give the
/// same list.
using ListInside = int(RawPoints points, const Frustum& frustum, int* list, std::int32_t& largest);

ListInside* frustum_kernel(SimdLevel level);

}  // namespace fusionslam::detail
