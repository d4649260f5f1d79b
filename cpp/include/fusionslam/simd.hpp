// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "fusionslam/config.hpp"

namespace fusionslam {

/// The instruction sets the hot loops are compiled for. Results do not depend on the choice.
enum class SimdLevel { baseline, avx2, avx512 };

template <>
struct ChoiceNames<SimdLevel> {
  static constexpr std::array<std::string_view, 3> value{"baseline", "avx2", "avx512"};
};

/// The highest level this machine has.
SimdLevel best_simd_level();

/// The level in use: the best one, or that of the environment variable FUSIONSLAM_SIMD, which is
/// read once. Throws ConfigError if it names an unknown level or one this machine lacks.
SimdLevel simd_level();

}  // namespace fusionslam
