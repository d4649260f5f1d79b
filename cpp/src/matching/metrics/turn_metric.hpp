// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Rows of columns that go around in a circle: 1 - their correlation at the turn where it is most.
#pragma once

#include <algorithm>
#include <cstring>
#include <numbers>
#include <vector>

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

/// Writes the columns of a row, each of unit length or zero, and returns how many are filled.
inline std::size_t write_unit_columns(std::span<const float> row, std::size_t columns,
                                      std::span<float> unit) {
  const ColumnKernels kernels = column_kernels(simd_level());
  std::vector<double> factors(columns);
  const std::size_t bins = row.size() / columns;
  const std::size_t filled = kernels.find_factors(row.data(), columns, bins, factors.data());
  kernels.scale(row.data(), columns, bins, factors.data(), unit.data());
  return filled;
}

/// How a metric of this kind takes a row.
struct TurnRule {
  std::size_t parts;  ///< each gets unit length: the columns, or 1 for the row as a whole
  double period;      ///< angle that all columns cover
};

/// Unit parts of rows. What is prepared of a row: the number of parts that are filled, the factors
/// that give them unit length, the spectra.
template <std::size_t turns>
class TurnMetric final : public RowMetric {
 public:
  TurnMetric(std::size_t dimension, TurnRule rule)
      : RowMetric(dimension),
        rule_(rule),
        columns_(column_kernels(simd_level())),
        kernels_(turn_kernels<turns>(simd_level())) {}

  std::size_t cache_size() const override {
    return spectra_begin() + bins() * ring_spectrum(turns);
  }

  void prepare(std::span<const float> row, std::span<float> cache) const override {
    std::vector<double> factors(rule_.parts);
    AlignedFloats unit(row.size());
    cache[0] = static_cast<float>(
        columns_.find_factors(row.data(), rule_.parts, part_size(), factors.data()));
    std::memcpy(cache.data() + column_lanes, factors.data(), factors.size() * sizeof(double));
    scale(row.data(), cache.data(), unit.data());
    kernels_.transform(unit.data(), bins(), cache.data() + spectra_begin());
  }

  std::unique_ptr<RowQuery> query(std::span<const float> row) const override;

  /// Writes the unit parts of a row that was prepared.
  void scale(const float* row, const float* cache, float* unit) const {
    double factors[turns];
    std::memcpy(factors, cache + column_lanes, rule_.parts * sizeof(double));
    columns_.scale(row, rule_.parts, part_size(), factors, unit);
  }

  void correlate(const float* query_cache, const float* row_cache, float* dots) const {
    kernels_.correlate(query_cache + spectra_begin(), row_cache + spectra_begin(), bins(), dots);
  }

  /// Of what correlate() writes.
  double error() const {
    return correlation_error(turns, bins(), static_cast<double>(rule_.parts));
  }

  const ColumnKernels& columns() const { return columns_; }
  std::size_t bins() const { return dimension() / turns; }
  double period() const { return rule_.period; }

 private:
  std::size_t part_size() const { return dimension() / rule_.parts; }
  std::size_t spectra_begin() const { return column_lanes + whole_lanes(2 * rule_.parts); }

  TurnRule rule_;
  ColumnKernels columns_;
  TurnKernels kernels_;
};

template <std::size_t turns>
class TurnQuery final : public RowQuery {
 public:
  TurnQuery(const TurnMetric<turns>& metric, std::span<const float> query)
      : metric_(metric),
        size_(whole_lanes(query.size())),
        cache_(metric.cache_size()),
        query_(query.size() + size_),
        row_(size_) {
    metric.prepare(query, cache_);
    metric.scale(query.data(), cache_.data(), query_.data());
    std::copy_n(query_.data(), query.size(), query_.data() + query.size());
  }

  Distance compare(const Candidate& candidate) override {
    find_peak(candidate);
    return compare_at_peak(candidate);
  }

  double distance(const Candidate& candidate, double worst) override {
    const double least = 1 - (find_peak(candidate) + metric_.error()) / filled(candidate);
    return least > worst ? least : compare_at_peak(candidate).value;
  }

 private:
  /// Parts of the fuller row; of two empty ones 1, so that their distance is 1.
  double filled(const Candidate& candidate) const {
    return static_cast<double>(std::max({cache_[0], candidate.cache[0], 1.0F}));
  }

  /// The largest correlation, but for its error.
  double find_peak(const Candidate& candidate) {
    metric_.correlate(cache_.data(), candidate.cache, correlations_);
    return static_cast<double>(*std::ranges::max_element(correlations_));
  }

  /// Exactly, at the turns that may be the best one.
  Distance compare_at_peak(const Candidate& candidate) {
    const auto peak = static_cast<double>(*std::ranges::max_element(correlations_));
    metric_.scale(candidate.row, candidate.cache, row_.data());
    float most = -std::numeric_limits<float>::infinity();
    std::size_t best = 0;
    for (std::size_t turn = 0; turn < turns; ++turn) {
      if (static_cast<double>(correlations_[turn]) < peak - 2 * metric_.error()) continue;
      float dot = 0;
      metric_.columns().dots(query_.data() + turn * metric_.bins(), row_.data(), metric_.bins(),
                             size_, 1, &dot);
      if (dot > most) {
        most = dot;
        best = turn;
      }
    }
    const double cosine = static_cast<double>(most) / filled(candidate);
    return {std::max(0.0, 1 - cosine), yaw_of(best, turns, metric_.period())};
  }

  const TurnMetric<turns>& metric_;
  std::size_t size_;  ///< of a row, in whole lanes
  AlignedFloats cache_;
  AlignedFloats query_;  ///< columns, twice
  AlignedFloats row_;
  float correlations_[turns];
};

template <std::size_t turns>
std::unique_ptr<RowQuery> TurnMetric<turns>::query(std::span<const float> row) const {
  return std::make_unique<TurnQuery<turns>>(*this, row);
}

}  // namespace fusionslam::detail
