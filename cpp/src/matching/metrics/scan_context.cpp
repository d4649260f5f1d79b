// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "metrics.hpp"
#include "turn_metric.hpp"

namespace fusionslam {
namespace detail {

MetricPointer scan_context_metric(std::size_t dimension) {
  check_multiple("scan_context", dimension, scan_context_sectors);
  return std::make_unique<TurnMetric<scan_context_sectors>>(
      dimension, TurnRule{scan_context_sectors, 2 * std::numbers::pi});
}

}  // namespace detail

TurnedMatch compare_scan_contexts(std::span<const float> query, std::span<const float> match) {
  const DescriptorMatch found = compare_descriptors(query, match, Metric::scan_context);
  return {found.distance, found.yaw.value()};
}

}  // namespace fusionslam
