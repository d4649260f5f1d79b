// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// One query against all rows.
#pragma once

#include "../detail/interrupt.hpp"
#include "distance_kernel.hpp"
#include "nearest.hpp"

namespace fusionslam::detail {

/// Squares of float differences have a relative error, so nearly nothing but the nearest passes.
class DirectFilter {
 public:
  DirectFilter(std::size_t dimension) : error_(direct_error(dimension)) {}

  float limit(double squared) const {
    return round_up(squared * (1 + error_.relative) + error_.absolute);
  }

 private:
  ErrorBound error_;
};

/// Finds the nearest rows of one query; `row_of(index)` is where a row lies.
template <class RowOf>
class DirectSearch {
 public:
  DirectSearch(std::span<const float> query, std::size_t k, RowOf row_of, SimdLevel level)
      : query_(query),
        row_of_(row_of),
        kernels_(distance_kernels(level)),
        filter_(query.size()),
        shortlist_(k) {}

  /// Rows [begin, end) lie one after the other.
  template <class IsCandidate>
  void scan(std::size_t begin, std::size_t end, IsCandidate&& is_candidate) {
    float squares[block];
    for (; begin < end; begin += block) {
      check_interrupt();
      const std::size_t count = std::min(block, end - begin);
      kernels_.squares(query_.data(), row_of_(begin), count, query_.size(), shortlist_.limit(),
                       squares);
      for (std::size_t i = 0; i < count; ++i)
        if (!(squares[i] > shortlist_.limit()) && is_candidate(begin + i))
          shortlist_.add(static_cast<std::int64_t>(begin + i), squares[i], *this);
    }
  }

  std::vector<Match> matches() { return shortlist_.matches(*this); }

  float limit(double squared) const { return filter_.limit(squared); }
  double exact(std::int64_t index, double) const {
    return squared_distance(query_.data(), row_of_(static_cast<std::size_t>(index)), query_.size());
  }

 private:
  static constexpr std::size_t block = 128;
  std::span<const float> query_;
  RowOf row_of_;
  DistanceKernels kernels_;
  DirectFilter filter_;
  Shortlist shortlist_;
};

}  // namespace fusionslam::detail
