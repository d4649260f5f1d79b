// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "nearest.hpp"

#include <algorithm>
#include <limits>
#include <string>

#include "../detail/interrupt.hpp"
#include "batch_search.hpp"
#include "fusionslam/errors.hpp"
#include "metrics/row_metric.hpp"

namespace fusionslam {
namespace detail {

void check_values(std::span<const float> descriptor, std::size_t row) {
  // No distance of two vectors of at most this length is above the largest float.
  constexpr double longest = 0.5 * static_cast<double>(std::numeric_limits<float>::max());
  const double safe = longest / std::sqrt(static_cast<double>(descriptor.size())) * 0.999;
  if (all_within(descriptor.data(), descriptor.size(), static_cast<float>(safe))) return;
  for (std::size_t i = 0; i < descriptor.size(); ++i)
    if (!std::isfinite(descriptor[i]))
      throw DataError("descriptor " + std::to_string(row) + " is not finite at position " +
                      std::to_string(i));
  if (std::sqrt(squared_norm(descriptor.data(), descriptor.size())) > longest)
    throw DataError("descriptor " + std::to_string(row) +
                    " is too long: distances beyond the largest float, 3.4e38, are possible");
}

}  // namespace detail

namespace {

void check_dimension(std::span<const float> values, std::size_t dimension) {
  if (dimension == 0 || values.size() % dimension != 0)
    throw ShapeError(std::to_string(values.size()) + " values are no rows of dimension " +
                     std::to_string(dimension));
}

detail::Vectors check_rows(const detail::RowMetric* metric, std::span<const float> values,
                           std::size_t dimension) {
  for (std::size_t row = 0; row < values.size() / dimension; ++row) {
    detail::check_interrupt();
    detail::check_row(metric, values.subspan(row * dimension, dimension), row);
  }
  return {values.data(), values.size() / dimension, dimension};
}

void check_k(std::size_t k, std::size_t queries) {
  constexpr std::size_t most = std::size_t{1} << 32;  // results beyond that are a mistake
  if (k == 0 || k > most / std::max<std::size_t>(queries, 1))
    throw ConfigError("k is " + std::to_string(k) + ", expected at least 1 and results that fit");
}

}  // namespace

MatchTable nearest(std::span<const float> queries, std::span<const float> descriptors,
                   std::size_t dimension, std::size_t k, int threads, Metric metric) {
  check_dimension(queries, dimension);
  check_dimension(descriptors, dimension);
  const auto row_metric = detail::make_row_metric(metric, dimension);
  const auto wanted = check_rows(row_metric.get(), queries, dimension);
  const auto rows = check_rows(row_metric.get(), descriptors, dimension);
  check_k(k, wanted.count);
  if (row_metric)
    return detail::search_rows(*row_metric, queries, descriptors, std::nullopt, k, threads);
  return detail::BatchSearch(wanted, rows, std::nullopt, k, simd_level()).run(threads);
}

MatchTable nearest_causal(std::span<const float> descriptors, std::size_t dimension,
                          std::size_t window, std::size_t k, int threads, Metric metric) {
  check_dimension(descriptors, dimension);
  const auto row_metric = detail::make_row_metric(metric, dimension);
  const auto rows = check_rows(row_metric.get(), descriptors, dimension);
  check_k(k, rows.count);
  if (row_metric)
    return detail::search_rows(*row_metric, descriptors, descriptors, window, k, threads);
  return detail::BatchSearch(rows, rows, window, k, simd_level()).run(threads);
}

}  // namespace fusionslam
