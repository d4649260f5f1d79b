// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/simd.hpp"

/// The SIMD levels this machine can run, the baseline first.
inline std::vector<fusionslam::SimdLevel> simd_levels() {
  using fusionslam::SimdLevel;
  std::vector<SimdLevel> levels;
  for (const SimdLevel level : {SimdLevel::baseline, SimdLevel::avx2, SimdLevel::avx512})
    if (level <= fusionslam::best_simd_level()) levels.push_back(level);
  return levels;
}
