// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <numbers>

namespace fusionslam::detail {

/// atan2 to 1e-4 rad, a hundredth of the smallest cell worth looking at, in a fifth of its time.
inline float quick_atan2(float y, float x) {
  const float ax = std::fabs(x), ay = std::fabs(y);
  const float longer = ax > ay ? ax : ay, shorter = ax > ay ? ay : ax;
  if (longer == 0) return 0;
  const float t = shorter / longer, s = t * t;
  // Least-squares polynomial of atan on [0, 1].
  float angle =
      t * (0.99997726f +
           s * (-0.33262347f +
                s * (0.19354346f + s * (-0.11643287f + s * (0.05265332f - s * 0.01172120f)))));
  if (ay > ax) angle = std::numbers::pi_v<float> / 2 - angle;
  if (x < 0) angle = std::numbers::pi_v<float> - angle;
  return y < 0 ? -angle : angle;
}

}  // namespace fusionslam::detail
