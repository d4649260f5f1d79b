// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>

#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

/// Whether it is a rotation, to 1e-2 as in text with few digits, and a translation.
inline bool is_rigid(const Transform& motion) {
  const auto dot = [&](std::size_t i, std::size_t j) {
    return motion[4 * i] * motion[4 * j] + motion[4 * i + 1] * motion[4 * j + 1] +
           motion[4 * i + 2] * motion[4 * j + 2];
  };
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j <= i; ++j)
      if (!(std::abs(dot(i, j) - (i == j ? 1 : 0)) <= 1e-2)) return false;  // NaN, too
  const auto& m = motion;
  const double determinant = m[0] * (m[5] * m[10] - m[6] * m[9]) -
                             m[1] * (m[4] * m[10] - m[6] * m[8]) +
                             m[2] * (m[4] * m[9] - m[5] * m[8]);
  return determinant > 0 && std::isfinite(m[3] + m[7] + m[11]) && m[12] == 0 && m[13] == 0 &&
         m[14] == 0 && m[15] == 1;
}

}  // namespace fusionslam::detail
