// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "block_sets.hpp"
#include "metrics.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t region_size = 308;  // a VFH signature

FUSIONSLAM_INLINE double unlikeness(const float* a, const float* b) {
  const double least = sum_in_lanes(
      region_size, [&](std::size_t i) { return static_cast<double>(std::min(a[i], b[i])); });
  const double most = sum_in_lanes(
      region_size, [&](std::size_t i) { return static_cast<double>(std::max(a[i], b[i])); });
  return 1 - (1 + least) / (1 + most);
}

/// Histograms of a scan's smooth regions (CVFH; Aldoma et al., ICCV workshops 2011, section 4):
/// 1 - (1 + sum of min) / (1 + sum of max) of the two regions that are most alike.
class Regions final : public PlainMetric {
 public:
  explicit Regions(std::size_t dimension) : PlainMetric(dimension) {
    check_multiple("regions", dimension, region_size);
  }

  void check(std::span<const float> row, std::size_t number) const override {
    check_not_negative("regions", row, number);
    check_blocks("regions", row, region_size, number);
  }

  double distance(std::span<const float> query, std::span<const float> row) const override {
    auto* between = compiled_for<unlikeness>(simd_level());
    return least_of_blocks(query, row, region_size,
                           [&](auto a, auto b) { return between(a.data(), b.data()); });
  }
};

}  // namespace

MetricPointer regions_metric(std::size_t dimension) { return std::make_unique<Regions>(dimension); }

}  // namespace fusionslam::detail
