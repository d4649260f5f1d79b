// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace fusionslam::detail {

/// A node while it is relaxed; cosine and sine of its heading follow it.
struct SweptNode {
  double x, y, heading, cosine, sine;
};

/// A link while it is relaxed: the way in the frame of the source, and the rotation.
struct SweptLink {
  std::int64_t source, target;
  double forward, left, facing;
};

/// Sums over links of the squared errors of place and rotation.
struct SweptSquares {
  double place = 0, rotation = 0;
};

/// One sweep over the links in their order: both ends move by `part` of the error, at once (Ball et
/// al. 2013). Returns the errors that each link had before its turn.
SweptSquares sweep(SweptNode* nodes, const SweptLink* links, std::size_t count, double part);

}  // namespace fusionslam::detail
