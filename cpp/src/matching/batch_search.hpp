// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Many queries against all rows, in tiles of dot products as a matrix product is computed.
#pragma once

#include <optional>

#include "distance_kernel.hpp"
#include "fusionslam/matching.hpp"
#include "row_chunks.hpp"

namespace fusionslam::detail {

/// Row-major vectors one after the other.
struct Vectors {
  const float* data;
  std::size_t count;
  std::size_t dimension;

  const float* operator[](std::size_t i) const { return data + i * dimension; }
};

/// The k nearest rows of each query; with a window only rows before query number - window.
class BatchSearch {
 public:
  BatchSearch(Vectors queries, Vectors rows, std::optional<std::size_t> window, std::size_t k,
              SimdLevel level);

  MatchTable run(int threads);

 private:
  class Block;

  /// Candidates of a query are the rows below this.
  std::size_t end_of(std::size_t query) const;
  std::size_t block_size(int threads) const;
  void find_center();
  void find_row_terms(int threads);
  double centred_norm(const float* vector, AlignedFloats& buffer) const;
  void search_block(std::size_t first, std::size_t count, MatchTable& table);
  void search_one(std::size_t query, MatchTable& table) const;
  void store(std::size_t query, const std::vector<Match>& matches, MatchTable& table) const;

  Vectors queries_;
  Vectors rows_;
  std::optional<std::size_t> window_;
  std::size_t k_;
  SimdLevel level_;
  DistanceKernels kernels_;
  ErrorBound error_;
  AlignedFloats center_;
  AlignedFloats row_terms_;  ///< |row|^2 less its share of the error, after centring
};

}  // namespace fusionslam::detail
