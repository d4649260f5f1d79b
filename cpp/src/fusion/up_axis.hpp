// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "fusionslam/fusion.hpp"

namespace fusionslam::detail {

/// A coordinate and the sign with which it counts upwards.
struct Axis {
  std::size_t coordinate;
  double sign;
};

inline Axis axis_of(UpAxis up) {
  const auto number = static_cast<std::size_t>(up);
  return {number % 3, number < 3 ? 1.0 : -1.0};
}

}  // namespace fusionslam::detail
