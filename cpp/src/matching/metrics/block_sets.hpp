// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Rows that hold a set: blocks of one length, of which those that are all zeros are absent.
#pragma once

#include <algorithm>
#include <limits>

#include "fusionslam/errors.hpp"
#include "row_metric.hpp"

namespace fusionslam::detail {

inline bool is_present(std::span<const float> block) {
  return std::ranges::any_of(block, [](float value) { return value != 0; });
}

/// Calls visit(block) for each block that is present.
template <class Visit>
void visit_blocks(std::span<const float> row, std::size_t block_size, Visit&& visit) {
  for (; !row.empty(); row = row.subspan(block_size))
    if (is_present(row.first(block_size))) visit(row.first(block_size));
}

/// Throws DataError if the row has no block: a set without members has no distance.
inline void check_blocks(std::string_view metric, std::span<const float> row,
                         std::size_t block_size, std::size_t number) {
  bool found = false;
  visit_blocks(row, block_size, [&](std::span<const float>) { found = true; });
  if (found) return;
  throw DataError("descriptor " + std::to_string(number) + " is an empty set: metric " +
                  std::string(metric) + " takes at least one block of " +
                  std::to_string(block_size) + " values that are not all zero");
}

/// The least between(a, b) of a block of `query` and one of `row`.
template <class Between>
double least_of_blocks(std::span<const float> query, std::span<const float> row,
                       std::size_t block_size, Between&& between) {
  double least = std::numeric_limits<double>::infinity();
  visit_blocks(query, block_size, [&](std::span<const float> a) {
    visit_blocks(row, block_size,
                 [&](std::span<const float> b) { least = std::min(least, between(a, b)); });
  });
  return least;
}

}  // namespace fusionslam::detail
