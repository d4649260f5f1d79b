// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace fusionslam::detail {

/// Squared L2 distance of two float vectors, accumulated in double.
double squared_distance(const float* a, const float* b, std::size_t size);

}  // namespace fusionslam::detail
