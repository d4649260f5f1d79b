// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// How descriptors are compared other than by L2. Each metric has a file of its own in this folder
// and a line in row_metric.cpp.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "../../detail/simd.hpp"
#include "fusionslam/matching.hpp"

namespace fusionslam::detail {

/// A row to compare with, and what RowMetric::prepare() wrote of it.
struct Candidate {
  std::int64_t index;
  const float* row;
  const float* cache;
};

/// Distance of a query to a candidate, and the turn between them where the metric finds one.
struct Distance {
  double value;
  std::optional<double> yaw = std::nullopt;  ///< of TurnedMatch
};

/// One query, for one thread. Its metric and its row have to outlive it.
class RowQuery {
 public:
  virtual ~RowQuery() = default;

  virtual Distance compare(const Candidate& candidate) = 0;

  /// The distance, or anything above `worst` if it is above that.
  virtual double distance(const Candidate& candidate, double /*worst*/) {
    return compare(candidate).value;
  }

  /// The k nearest candidates, which come in the order of their indices.
  virtual std::vector<Match> nearest(std::span<const Candidate> candidates, std::size_t k);
};

/// A metric for rows of one length. Threads may share it.
class RowMetric {
 public:
  explicit RowMetric(std::size_t dimension) : dimension_(dimension) {}
  virtual ~RowMetric() = default;

  /// Throws DataError, naming the row `number`, if values that are finite have no meaning here.
  virtual void check(std::span<const float> /*row*/, std::size_t /*number*/) const {}

  /// Floats that prepare() writes of a row.
  virtual std::size_t cache_size() const { return 0; }
  virtual void prepare(std::span<const float> /*row*/, std::span<float> /*cache*/) const {}

  virtual std::unique_ptr<RowQuery> query(std::span<const float> row) const = 0;

  std::size_t dimension() const { return dimension_; }

 private:
  std::size_t dimension_;
};

/// A metric of which nothing is prepared.
class PlainMetric : public RowMetric {
 public:
  using RowMetric::RowMetric;

  virtual double distance(std::span<const float> query, std::span<const float> row) const = 0;

  std::unique_ptr<RowQuery> query(std::span<const float> row) const final;
};

/// None for L2, which has kernels of its own. Throws ShapeError if the metric is for rows of other
/// lengths.
std::unique_ptr<const RowMetric> make_row_metric(Metric metric, std::size_t dimension);

/// Throws as check_values() and RowMetric::check() do.
void check_row(const RowMetric* metric, std::span<const float> row, std::size_t number);

/// Throws ShapeError unless `dimension` is a multiple of `part`.
void check_multiple(std::string_view metric, std::size_t dimension, std::size_t part);

/// Throws DataError naming the first negative value.
void check_not_negative(std::string_view metric, std::span<const float> row, std::size_t number);

/// Throws DataError if distances between rows of such sums need not fit a float.
void check_sum(std::string_view metric, std::span<const float> row, std::size_t number);

/// nearest() and nearest_causal() with such a metric: with a window only rows before query number
/// - window are candidates.
MatchTable search_rows(const RowMetric& metric, std::span<const float> queries,
                       std::span<const float> rows, std::optional<std::size_t> window,
                       std::size_t k, int threads);

/// Sum of term(i) for i below size. Eight running sums are part of the result: the order of adding
/// does not depend on how this is vectorised.
template <class Term>
FUSIONSLAM_INLINE double sum_in_lanes(std::size_t size, Term&& term) {
  constexpr std::size_t lanes = 8;
  double sums[lanes] = {};
  std::size_t i = 0;
  for (; i + lanes <= size; i += lanes)
    for (std::size_t lane = 0; lane < lanes; ++lane) sums[lane] += term(i + lane);
  for (std::size_t lane = 0; i < size; ++i, ++lane) sums[lane] += term(i);
  return ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7]));
}

}  // namespace fusionslam::detail
