// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/descriptors.hpp"
#include "m2dp_kernel.hpp"

namespace fusionslam::detail {

/// Makes a signature over mirrored_planes() independent of the signs of the three axes.
///
/// Mirroring an axis moves the content of each bin to one other bin. Of each such pair the larger
/// value goes to the bin on the positive side, the smaller to its mirror image. Unlike a choice of
/// sign this is continuous: no small change of a cloud can turn it over. Sums are kept.
void sort_mirror_pairs(const M2dpConfig& config, const std::vector<KernelPlane>& planes,
                       Signature& signature);

}  // namespace fusionslam::detail
