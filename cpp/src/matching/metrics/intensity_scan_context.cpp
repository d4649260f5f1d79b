// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Intensity Scan Context (Wang, Wang, Xie, ICRA 2020): geometry, which bins are occupied, finds the
// turn; near it the intensities are compared. The paper has a threshold for each of the two
// similarities; here their product makes one distance.
#include <algorithm>

#include "../column_kernel.hpp"
#include "../row_chunks.hpp"
#include "metrics.hpp"
#include "turn_metric.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t sectors = scan_context_sectors;

class IntensityScanContext final : public RowMetric {
 public:
  explicit IntensityScanContext(std::size_t dimension) : RowMetric(dimension) {
    check_multiple("intensity_scan_context", dimension, sectors);
  }

  void check(std::span<const float> row, std::size_t number) const override {
    check_not_negative("intensity_scan_context", row, number);
  }

  /// Number of filled columns, then unit columns.
  std::size_t cache_size() const override { return column_lanes + whole_lanes(dimension()); }

  void prepare(std::span<const float> row, std::span<float> cache) const override {
    cache[0] = static_cast<float>(write_unit_columns(row, sectors, cache.subspan(column_lanes)));
  }

  std::unique_ptr<RowQuery> query(std::span<const float> row) const override;
};

class IntensityQuery final : public RowQuery {
 public:
  IntensityQuery(const IntensityScanContext& metric, std::span<const float> query)
      : dimension_(query.size()),
        bins_(dimension_ / sectors),
        size_(whole_lanes(dimension_)),
        kernels_(column_kernels(simd_level())),
        query_(2 * dimension_ + 2 * bins_ + size_),
        occupied_(2 * dimension_ + size_),
        row_occupied_(size_) {
    AlignedFloats cache(metric.cache_size());
    metric.prepare(query, cache);
    filled_ = cache[0];
    for (const std::size_t begin : {std::size_t{0}, dimension_})
      std::copy_n(cache.begin() + column_lanes, dimension_, query_.data() + begin);
    std::copy_n(cache.begin() + column_lanes, 2 * bins_, query_.data() + 2 * dimension_);
    occupied_count_ = mark_occupied(query.data(), occupied_.data());
    std::copy_n(occupied_.data(), dimension_, occupied_.data() + dimension_);
  }

  Distance compare(const Candidate& candidate) override {
    const std::size_t count = mark_occupied(candidate.row, row_occupied_.data());
    float both[sectors];  // whole numbers below 2^24, so exact
    kernels_.dots(occupied_.data(), row_occupied_.data(), bins_, size_, sectors, both);
    const float* best = std::ranges::max_element(both);
    const auto turn = static_cast<std::size_t>(best - both);
    const double unequal =
        static_cast<double>(occupied_count_ + count) - 2 * static_cast<double>(*best);
    const double geometry = 1 - unequal / static_cast<double>(dimension_);

    const std::size_t first = (turn + sectors - 1) % sectors;
    float cosines[3];  // one column less, as many, one more
    kernels_.dots(query_.data() + first * bins_, candidate.cache + column_lanes, bins_, size_, 3,
                  cosines);
    const float* most = std::ranges::max_element(cosines);
    const double filled = static_cast<double>(std::max(filled_, candidate.cache[0]));
    const double intensity = filled > 0 ? static_cast<double>(*most) / filled : 0;
    const std::size_t shift = (first + static_cast<std::size_t>(most - cosines)) % sectors;
    return {std::max(0.0, 1 - geometry * intensity), yaw_of(shift, sectors, 2 * std::numbers::pi)};
  }

 private:
  /// Writes 1 where a bin is occupied, 0 elsewhere, and returns how many are.
  std::size_t mark_occupied(const float* row, float* occupied) const {
    std::size_t count = 0;
    for (std::size_t i = 0; i < dimension_; ++i) {
      occupied[i] = row[i] > 0 ? 1.0F : 0.0F;
      count += row[i] > 0 ? 1 : 0;
    }
    return count;
  }

  std::size_t dimension_;
  std::size_t bins_;
  std::size_t size_;  ///< of a row, in whole lanes
  ColumnKernels kernels_;
  AlignedFloats query_;     ///< unit columns, twice, and two more
  AlignedFloats occupied_;  ///< twice
  AlignedFloats row_occupied_;
  float filled_ = 0;
  std::size_t occupied_count_ = 0;
};

std::unique_ptr<RowQuery> IntensityScanContext::query(std::span<const float> row) const {
  return std::make_unique<IntensityQuery>(*this, row);
}

}  // namespace

MetricPointer intensity_scan_context_metric(std::size_t dimension) {
  return std::make_unique<IntensityScanContext>(dimension);
}

}  // namespace fusionslam::detail
