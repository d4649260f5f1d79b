// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "../detail/point_blocks.hpp"

namespace fusionslam::detail {

/// The inside of a SurfaceCloud.
struct SurfaceBlocks {
  PointBlocks cloud;
  std::vector<PointBlock> normals;  ///< of the points at the same places
  int neighbors;                    ///< that gave a point its normal
};

}  // namespace fusionslam::detail
