// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "metrics.hpp"
#include "turn_metric.hpp"

namespace fusionslam::detail {

// 120 angles of a Radon transform over half a turn: the magnitudes of its spectra along the offset
// are the same for the other half (RING; Lu et al., IROS 2022, section III).
MetricPointer ring_metric(std::size_t dimension) {
  constexpr std::size_t angles = 120;
  check_multiple("ring", dimension, angles);
  return std::make_unique<TurnMetric<angles>>(dimension, TurnRule{1, std::numbers::pi});
}

}  // namespace fusionslam::detail
