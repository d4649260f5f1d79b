// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "metrics.hpp"

namespace fusionslam::detail {
namespace {

FUSIONSLAM_INLINE double sum_terms(const float* query, const float* row, std::size_t size) {
  return sum_in_lanes(size, [&](std::size_t i) {
    const double a = static_cast<double>(query[i]), b = static_cast<double>(row[i]);
    const double sum = a + b > 0 ? a + b : 1;  // an empty bin adds 0 / 1
    return (a - b) * (a - b) / sum;
  });
}

/// Of histograms: the sum of (a - b)^2 / (a + b) over the bins filled in either.
class ChiSquare final : public PlainMetric {
 public:
  using PlainMetric::PlainMetric;

  void check(std::span<const float> row, std::size_t number) const override {
    check_not_negative("chi_square", row, number);
    check_sum("chi_square", row, number);  // (a - b)^2 <= (a + b)^2
  }

  double distance(std::span<const float> query, std::span<const float> row) const override {
    return compiled_for<sum_terms>(simd_level())(query.data(), row.data(), query.size());
  }
};

}  // namespace

MetricPointer chi_square_metric(std::size_t dimension) {
  return std::make_unique<ChiSquare>(dimension);
}

}  // namespace fusionslam::detail
