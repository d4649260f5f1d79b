// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/descriptors.hpp"

namespace fusionslam::detail {

/// First left and right singular vectors of a matrix of non-negative entries, concatenated.
/// Both can be chosen non-negative (Perron and Frobenius) and are.
std::vector<float> first_singular_vectors(const Signature& signature);

}  // namespace fusionslam::detail
