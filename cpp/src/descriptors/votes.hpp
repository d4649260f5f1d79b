// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "color_space.hpp"
#include "fusionslam/descriptors.hpp"
#include "m2dp_kernel.hpp"
#include "moments_kernel.hpp"

namespace fusionslam::detail {

/// Points to count, in a frame whose unit is the outer radius, and their colours.
struct VoteTask {
  RawPoints points;
  KernelFrame frame;
  const ColorBinner* colors = nullptr;  ///< null for M2DP
};

/// True if the fast kernel, which supports the papers' sizes only, can count on these planes.
bool is_fast_case(const M2dpConfig& config, const std::vector<KernelPlane>& planes);

/// Votes of all points on all planes, in the columns of a signature. Sums of whole numbers, so the
/// result depends neither on `threads` nor on `level`.
Signature count_votes(const VoteTask& task, const std::vector<KernelPlane>& planes,
                      const M2dpConfig& config, SimdLevel level, int threads);

}  // namespace fusionslam::detail
