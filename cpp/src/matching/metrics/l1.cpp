// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "metrics.hpp"

namespace fusionslam::detail {
namespace {

FUSIONSLAM_INLINE double sum_differences(const float* a, const float* b, std::size_t size) {
  return sum_in_lanes(size, [&](std::size_t i) {
    return std::abs(static_cast<double>(a[i]) - static_cast<double>(b[i]));
  });
}

/// Sum of the magnitudes of the differences.
class L1 final : public PlainMetric {
 public:
  using PlainMetric::PlainMetric;

  void check(std::span<const float> row, std::size_t number) const override {
    check_sum("l1", row, number);
  }

  double distance(std::span<const float> query, std::span<const float> row) const override {
    return compiled_for<sum_differences>(simd_level())(query.data(), row.data(), query.size());
  }
};

}  // namespace

MetricPointer l1_metric(std::size_t dimension) { return std::make_unique<L1>(dimension); }

}  // namespace fusionslam::detail
