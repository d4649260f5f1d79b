// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Vectors as wide as a level has them, for loops that keep what they find in registers.
#pragma once

#include <cstdint>

namespace fusionslam::detail {

struct Vectors16 {
  using Floats = float __attribute__((vector_size(16)));
  using Integers = std::int32_t __attribute__((vector_size(16)));
};
struct Vectors32 {
  using Floats = float __attribute__((vector_size(32)));
  using Integers = std::int32_t __attribute__((vector_size(32)));
};
struct Vectors64 {
  using Floats = float __attribute__((vector_size(64)));
  using Integers = std::int32_t __attribute__((vector_size(64)));
};

}  // namespace fusionslam::detail
