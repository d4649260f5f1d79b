// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "fusionslam/views/scene.hpp"

namespace fusionslam::detail {

/// The hull of points (columns) that span space, by Qhull; nothing if Qhull finds them flat. Safe
/// in several threads at once. Throws DataError with Qhull's words if it fails in another way.
std::optional<Hull> solid_hull(Eigen::Matrix3Xd& points);

}  // namespace fusionslam::detail
