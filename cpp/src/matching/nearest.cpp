// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "nearest.hpp"

#include <algorithm>
#include <limits>
#include <string>

#include "../detail/parallel.hpp"
#include "fusionslam/errors.hpp"

namespace fusionslam {
namespace detail {

void check_finite(std::span<const float> descriptor, std::size_t row) {
  for (std::size_t i = 0; i < descriptor.size(); ++i)
    if (!std::isfinite(descriptor[i]))
      throw DataError("descriptor " + std::to_string(row) + " is not finite at position " +
                      std::to_string(i));
}

}  // namespace detail

namespace {

void check_table(std::span<const float> descriptors, std::size_t dimension, std::size_t k) {
  if (dimension == 0 || descriptors.size() % dimension != 0)
    throw ShapeError(std::to_string(descriptors.size()) + " values are no rows of dimension " +
                     std::to_string(dimension));
  constexpr std::size_t most = std::size_t{1} << 32;  // results beyond that are a mistake
  if (k == 0 || k > most / std::max<std::size_t>(descriptors.size() / dimension, 1))
    throw ConfigError("k is " + std::to_string(k) + ", expected at least 1 and results that fit");
  for (std::size_t row = 0; row < descriptors.size() / dimension; ++row)
    detail::check_finite(descriptors.subspan(row * dimension, dimension), row);
}

std::vector<Match> nearest_before(const float* rows, std::size_t dimension, std::size_t query,
                                  std::size_t end, std::size_t k) {
  detail::NearestK nearest(k);
  const float* descriptor = rows + query * dimension;
  for (std::size_t j = 0; j < end; ++j)
    nearest.offer(static_cast<std::int64_t>(j),
                  detail::squared_distance(descriptor, rows + j * dimension, dimension));
  return nearest.matches();
}

}  // namespace

MatchTable nearest_causal(std::span<const float> descriptors, std::size_t dimension,
                          std::size_t window, std::size_t k, int threads) {
  check_table(descriptors, dimension, k);
  const std::size_t rows = descriptors.size() / dimension;
  MatchTable table{k, std::vector<std::int64_t>(rows * k, -1),
                   std::vector<float>(rows * k, std::numeric_limits<float>::infinity())};
  detail::parallel_for(rows, threads, [&](std::size_t i) {
    const std::size_t end = i > window ? i - window : 0;
    const auto matches = nearest_before(descriptors.data(), dimension, i, end, k);
    for (std::size_t rank = 0; rank < matches.size(); ++rank) {
      table.indices[i * k + rank] = matches[rank].index;
      table.distances[i * k + rank] = matches[rank].distance;
    }
  });
  return table;
}

}  // namespace fusionslam
