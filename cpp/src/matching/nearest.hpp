// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "distance_kernel.hpp"
#include "fusionslam/matching.hpp"

namespace fusionslam::detail {

/// Keeps the k nearest of the candidates offered to it; equal distances go to the lowest index.
class NearestK {
 public:
  explicit NearestK(std::size_t k) : k_(k) {}

  void offer(std::int64_t index, double squared) {
    if (found_.size() == k_ && squared >= found_.back().squared) return;
    const auto place = std::upper_bound(
        found_.begin(), found_.end(), squared,
        [](double value, const Candidate& candidate) { return value < candidate.squared; });
    found_.insert(place, {index, squared});
    if (found_.size() > k_) found_.pop_back();
  }

  std::vector<Match> matches() const {
    std::vector<Match> result;
    for (const auto& [index, squared] : found_)
      result.push_back({index, static_cast<float>(std::sqrt(squared))});
    return result;
  }

 private:
  struct Candidate {
    std::int64_t index;
    double squared;
  };
  std::size_t k_;
  std::vector<Candidate> found_;
};

/// Throws DataError naming the first value that is not finite.
void check_finite(std::span<const float> descriptor, std::size_t row);

}  // namespace fusionslam::detail
