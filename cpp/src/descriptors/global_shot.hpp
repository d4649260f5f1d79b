// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "fusionslam/descriptors.hpp"

namespace fusionslam::detail {

/// SHOT, or with colours CSHOT, at the mean of the points that have a normal, all of which support
/// it. Throws DataError if these are equal or have no local frame.
std::vector<float> global_shot(PointsView points, ColorsView colors, const Normals& normals,
                               int threads);

}  // namespace fusionslam::detail
