// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "row_metric.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "../../detail/interrupt.hpp"
#include "../../detail/parallel.hpp"
#include "../distance_kernel.hpp"
#include "../nearest.hpp"
#include "../row_chunks.hpp"
#include "fusionslam/errors.hpp"
#include "metrics.hpp"

namespace fusionslam {
namespace detail {
namespace {

/// In the order of Metric.
constexpr MetricPointer (*factories[])(std::size_t) = {
    nullptr,  // l2
    scan_context_metric,
    l1_metric,
    chi_square_metric,
    regions_metric,
    nearest_of_set_metric,
    votes_metric,
    aligned_polar_metric,
    aligned_cartesian_metric,
    intensity_scan_context_metric,
    iris_metric,
    ring_metric,
};
static_assert(std::size(factories) == ChoiceNames<Metric>::value.size());

class PlainQuery final : public RowQuery {
 public:
  PlainQuery(const PlainMetric& metric, std::span<const float> query)
      : metric_(metric), query_(query) {}

  Distance compare(const Candidate& candidate) override {
    return {metric_.distance(query_, {candidate.row, query_.size()})};
  }

 private:
  const PlainMetric& metric_;
  std::span<const float> query_;
};

std::string value_at(std::span<const float> row, std::size_t i) {
  return std::to_string(row[i]) + " at position " + std::to_string(i);
}

/// What prepare() writes of `count` rows.
AlignedFloats prepare_rows(const RowMetric& metric, std::span<const float> rows, int threads) {
  const std::size_t width = metric.cache_size(), dimension = metric.dimension();
  const std::size_t count = rows.size() / dimension;
  AlignedFloats caches(count * width);
  if (width == 0) return caches;
  parallel_for(count, threads, [&](std::size_t i) {
    metric.prepare(rows.subspan(i * dimension, dimension),
                   std::span(caches).subspan(i * width, width));
  });
  return caches;
}

}  // namespace

std::vector<Match> RowQuery::nearest(std::span<const Candidate> candidates, std::size_t k) {
  NearestK found(k);
  double worst = std::numeric_limits<double>::infinity();
  for (const Candidate& candidate : candidates) {
    check_interrupt();
    const double value = distance(candidate, worst);
    if (value > worst) continue;
    found.offer(candidate.index, value * value);
    worst = std::sqrt(found.worst());
  }
  return found.matches();
}

std::unique_ptr<RowQuery> PlainMetric::query(std::span<const float> row) const {
  return std::make_unique<PlainQuery>(*this, row);
}

std::unique_ptr<const RowMetric> make_row_metric(Metric metric, std::size_t dimension) {
  if (metric == Metric::l2) return nullptr;
  return factories[static_cast<std::size_t>(metric)](dimension);
}

void check_row(const RowMetric* metric, std::span<const float> row, std::size_t number) {
  check_values(row, number);
  if (metric != nullptr) metric->check(row, number);
}

void check_multiple(std::string_view metric, std::size_t dimension, std::size_t part) {
  if (dimension > 0 && dimension % part == 0) return;
  throw ShapeError("a descriptor has " + std::to_string(dimension) + " values, metric " +
                   std::string(metric) + " takes multiples of " + std::to_string(part));
}

void check_not_negative(std::string_view metric, std::span<const float> row, std::size_t number) {
  const auto negative = std::ranges::find_if(row, [](float value) { return value < 0; });
  if (negative == row.end()) return;
  throw DataError("descriptor " + std::to_string(number) + " is " +
                  value_at(row, static_cast<std::size_t>(negative - row.begin())) + ", metric " +
                  std::string(metric) + " takes values >= 0");
}

void check_sum(std::string_view metric, std::span<const float> row, std::size_t number) {
  constexpr double most = 0.499 * static_cast<double>(std::numeric_limits<float>::max());
  const double sum = sum_in_lanes(
      row.size(), [&](std::size_t i) { return std::abs(static_cast<double>(row[i])); });
  if (sum <= most) return;
  throw DataError("descriptor " + std::to_string(number) + " is too long for metric " +
                  std::string(metric) +
                  ": distances beyond the largest float, 3.4e38, are possible");
}

MatchTable search_rows(const RowMetric& metric, std::span<const float> queries,
                       std::span<const float> rows, std::optional<std::size_t> window,
                       std::size_t k, int threads) {
  const std::size_t dimension = metric.dimension(), width = metric.cache_size();
  const std::size_t count = queries.size() / dimension;
  const AlignedFloats caches = prepare_rows(metric, rows, threads);
  std::vector<Candidate> candidates(rows.size() / dimension);
  for (std::size_t i = 0; i < candidates.size(); ++i)
    candidates[i] = {static_cast<std::int64_t>(i), rows.data() + i * dimension,
                     caches.data() + i * width};
  MatchTable table{k, std::vector<std::int64_t>(count * k, -1),
                   std::vector<float>(count * k, std::numeric_limits<float>::infinity())};
  parallel_for(count, threads, [&](std::size_t i) {
    const std::size_t query = count - 1 - i;  // those with most candidates first
    const std::size_t end = window ? query - std::min(query, *window) : candidates.size();
    const auto matches = metric.query(queries.subspan(query * dimension, dimension))
                             ->nearest(std::span(candidates).first(end), k);
    for (std::size_t rank = 0; rank < matches.size(); ++rank) {
      table.indices[query * k + rank] = matches[rank].index;
      table.distances[query * k + rank] = matches[rank].distance;
    }
  });
  return table;
}

}  // namespace detail

DescriptorMatch compare_descriptors(std::span<const float> query, std::span<const float> match,
                                    Metric metric) {
  if (match.size() != query.size())
    throw ShapeError("descriptors have " + std::to_string(query.size()) + " and " +
                     std::to_string(match.size()) + " values, expected equal lengths");
  if (query.empty()) throw ShapeError("descriptors have no values, expected at least 1");
  const auto rows = detail::make_row_metric(metric, query.size());
  detail::check_row(rows.get(), query, 0);
  detail::check_row(rows.get(), match, 1);
  if (!rows)
    return {static_cast<float>(
                std::sqrt(detail::squared_distance(query.data(), match.data(), query.size()))),
            std::nullopt};
  detail::AlignedFloats cache(rows->cache_size());
  rows->prepare(match, cache);
  const auto [value, yaw] = rows->query(query)->compare({0, match.data(), cache.data()});
  return {static_cast<float>(value), yaw};
}

}  // namespace fusionslam
