// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <span>
#include <tuple>
#include <vector>

#include "fusionslam/matching.hpp"

namespace fusionslam::detail {

/// Keeps the k nearest of the candidates offered to it, in any order; equal distances go to the
/// lowest index.
class NearestK {
 public:
  explicit NearestK(std::size_t k) : k_(k) {}

  void offer(std::int64_t index, double squared) {
    const Candidate candidate{squared, index};
    if (found_.size() < k_) {
      found_.push_back(candidate);
      std::push_heap(found_.begin(), found_.end());
    } else if (candidate < found_.front()) {
      std::pop_heap(found_.begin(), found_.end());
      found_.back() = candidate;
      std::push_heap(found_.begin(), found_.end());
    }
  }

  /// The squared distance that a candidate must not exceed to be among the k nearest.
  double worst() const {
    return found_.size() < k_ ? std::numeric_limits<double>::infinity() : found_.front().squared;
  }

  std::vector<Match> matches() {
    std::sort_heap(found_.begin(), found_.end());
    std::vector<Match> result;
    for (const auto& [squared, index] : found_)
      result.push_back({index, static_cast<float>(std::sqrt(squared))});
    return result;
  }

 private:
  struct Candidate {
    double squared;
    std::int64_t index;
    friend bool operator<(const Candidate& a, const Candidate& b) {
      return std::tie(a.squared, a.index) < std::tie(b.squared, b.index);
    }
  };
  std::size_t k_;
  std::vector<Candidate> found_;  // a heap, the farthest first
};

/// The smallest float that is not below `value`.
inline float round_up(double value) {
  constexpr float infinity = std::numeric_limits<float>::infinity();
  if (!(value < static_cast<double>(std::numeric_limits<float>::max()))) return infinity;
  if (value < static_cast<double>(std::numeric_limits<float>::lowest())) return -infinity;
  const auto nearest = static_cast<float>(value);
  return static_cast<double>(nearest) < value ? std::nextafter(nearest, infinity) : nearest;
}

/// One query's candidates that passed a filter. They are collected before their exact distances
/// are computed, in the order of their bounds, because the first ones rule most of the others out.
class Shortlist {
 public:
  explicit Shortlist(std::size_t k)
      : nearest_(k), capacity_(64 + 4 * std::min<std::size_t>(k, 4096)) {}

  /// Candidates with a bound above this are not among the nearest.
  float limit() const { return limit_; }

  /// `filter` has limit(squared), the bound that no row within `squared` exceeds, and
  /// exact(index, worst), the squared distance, or infinity if that is above `worst`.
  template <class Filter>
  void add(std::int64_t index, float bound, const Filter& filter) {
    waiting_.push_back(
        {std::isnan(bound) ? -std::numeric_limits<float>::infinity() : bound, index});
    if (waiting_.size() == capacity_) settle(filter);
  }

  template <class Filter>
  std::vector<Match> matches(const Filter& filter) {
    settle(filter);
    return nearest_.matches();
  }

 private:
  struct Waiting {
    float bound;
    std::int64_t index;
  };

  template <class Filter>
  void settle(const Filter& filter) {
    std::ranges::make_heap(waiting_, std::greater(), &Waiting::bound);
    while (!waiting_.empty() && waiting_.front().bound <= limit_) {
      const std::int64_t index = waiting_.front().index;
      nearest_.offer(index, filter.exact(index, nearest_.worst()));
      limit_ = filter.limit(nearest_.worst());
      std::ranges::pop_heap(waiting_, std::greater(), &Waiting::bound);
      waiting_.pop_back();
    }
    waiting_.clear();
  }

  NearestK nearest_;
  std::size_t capacity_;
  std::vector<Waiting> waiting_;  // while settling a heap, the least bound first
  float limit_ = std::numeric_limits<float>::infinity();
};

/// Throws DataError naming the first value that is not finite, or if the vector is so long that
/// distances need not fit a float.
void check_values(std::span<const float> descriptor, std::size_t row);

}  // namespace fusionslam::detail
