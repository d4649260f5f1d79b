// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "../detail/point_blocks.hpp"
#include "fusionslam/descriptors.hpp"

namespace fusionslam::detail {

/// Throws ConfigError unless the radius is positive.
void check_normal_radius(double radius);

/// estimate_normals of a cloud of at least three points that lies in blocks.
Normals surface_normals(const PointBlocks& cloud, double radius, int threads);

/// cloud_resolution of a cloud of at least two points that lies in blocks.
double resolution(const PointBlocks& cloud, int threads);

}  // namespace fusionslam::detail
