// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "shot_kernel.hpp"

namespace fusionslam::detail {

/// Points that one call of a SHOT kernel gets: fixed, so that sums do not depend on threads.
inline constexpr std::size_t shot_chunk = 4096;

/// SHOT's repeatable frame (Tombari, Salti, Di Stefano 2010, 3.1): eigenvectors of the offsets
/// weighted by radius - distance, turned to where most points are. None for fewer than 5 points.
std::optional<ShotFrame> shot_reference_frame(const ShotSupport& support, int threads,
                                              const ShotKernels& kernels);

}  // namespace fusionslam::detail
