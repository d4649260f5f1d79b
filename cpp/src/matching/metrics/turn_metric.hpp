// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Rows of columns that go around in a circle: 1 - their correlation at the turn where it is most.
#pragma once

#include <algorithm>
#include <numbers>

#include "../row_chunks.hpp"
#include "../turn_kernel.hpp"
#include "row_metric.hpp"

namespace fusionslam::detail {

/// Turn of the query's frame in the match's, if the query from column `shift` of `turns` on looks
/// like the match; -period / 2 (excluded) to period / 2.
inline double yaw_of(std::size_t shift, std::size_t turns, double period) {
  // What the query sees `shift` columns further left, the match sees ahead.
  const double yaw = -period * static_cast<double>(shift) / static_cast<double>(turns);
  return yaw <= -period / 2 ? yaw + period : yaw;
}

/// How a metric of this kind takes a row.
struct TurnRule {
  std::size_t parts;  ///< each gets unit length: the columns, or 1 for the row as a whole
  double period;      ///< angle that all columns cover
};

/// Of one query. What is prepared of a row, and rules most rows out: the number of parts that are
/// filled, then the spectra.
template <std::size_t turns>
class TurnQuery final : public RowQuery {
 public:
  TurnQuery(std::span<const float> query, TurnRule rule)
      : rule_(rule),
        bins_(query.size() / turns),
        size_(whole_lanes(query.size())),
        columns_(column_kernels(simd_level())),
        kernels_(turn_kernels<turns>(simd_level())),
        query_(query.size() + size_),
        row_(size_),
        spectrum_(bins_ * ring_spectrum(turns)),
        filled_(normalize(query.data(), query_)) {
    kernels_.transform(query_.data(), bins_, spectrum_.data());
    std::copy_n(query_.begin(), query.size(),
                query_.begin() + static_cast<std::ptrdiff_t>(query.size()));
  }

  Distance compare(const Candidate& candidate) override {
    const std::size_t filled = std::max(filled_, normalize(candidate.row, row_));
    float dots[turns];
    columns_.dots(query_.data(), row_.data(), bins_, size_, turns, dots);
    const float* best = std::ranges::max_element(dots);
    const double cosine = filled > 0 ? static_cast<double>(*best) / static_cast<double>(filled) : 0;
    return {std::max(0.0, 1 - cosine),
            yaw_of(static_cast<std::size_t>(best - dots), turns, rule_.period)};
  }

  double distance(const Candidate& candidate, double worst) override {
    const double least = least_distance(candidate.cache);
    return least > worst ? least : compare(candidate).value;
  }

 private:
  std::size_t normalize(const float* row, AlignedFloats& unit) const {
    return columns_.normalize(row, rule_.parts, turns * bins_ / rule_.parts, unit.data());
  }

  /// No turn brings a row nearer than this.
  double least_distance(const float* cache) const {
    const auto filled = std::max(static_cast<double>(filled_), static_cast<double>(cache[0]));
    if (filled == 0) return 1;
    const float most = kernels_.correlate(spectrum_.data(), cache + column_lanes, bins_);
    const double error = correlation_error(turns, bins_, static_cast<double>(rule_.parts));
    return 1 - (static_cast<double>(most) + error) / filled;
  }

  TurnRule rule_;
  std::size_t bins_;
  std::size_t size_;  ///< of a row, in whole lanes
  ColumnKernels columns_;
  TurnKernels kernels_;
  AlignedFloats query_;  ///< columns, twice
  AlignedFloats row_;
  AlignedFloats spectrum_;
  std::size_t filled_;
};

template <std::size_t turns>
class TurnMetric final : public RowMetric {
 public:
  TurnMetric(std::size_t dimension, TurnRule rule) : RowMetric(dimension), rule_(rule) {}

  std::size_t cache_size() const override {
    return column_lanes + dimension() / turns * ring_spectrum(turns);
  }

  void prepare(std::span<const float> row, std::span<float> cache) const override {
    AlignedFloats unit(row.size());
    cache[0] = static_cast<float>(
        column_kernels(simd_level())
            .normalize(row.data(), rule_.parts, row.size() / rule_.parts, unit.data()));
    turn_kernels<turns>(simd_level())
        .transform(unit.data(), row.size() / turns, cache.data() + column_lanes);
  }

  std::unique_ptr<RowQuery> query(std::span<const float> row) const override {
    return std::make_unique<TurnQuery<turns>>(row, rule_);
  }

 private:
  TurnRule rule_;
};

}  // namespace fusionslam::detail
