// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "../distance_kernel.hpp"
#include "block_sets.hpp"
#include "metrics.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t alignments = 4;

/// One scan described at up to four alignments, the main one first, as NDT histograms at several
/// dominant directions (Magnusson et al., ICRA 2009): the least L2 distance of any two.
class NearestOfSet final : public PlainMetric {
 public:
  explicit NearestOfSet(std::size_t dimension) : PlainMetric(dimension) {
    check_multiple("nearest_of_set", dimension, alignments);
  }

  void check(std::span<const float> row, std::size_t number) const override {
    check_blocks("nearest_of_set", row, block_size(), number);
  }

  double distance(std::span<const float> query, std::span<const float> row) const override {
    return std::sqrt(least_of_blocks(query, row, block_size(), [&](auto a, auto b) {
      return squared_distance(a.data(), b.data(), block_size());
    }));
  }

 private:
  std::size_t block_size() const { return dimension() / alignments; }
};

}  // namespace

MetricPointer nearest_of_set_metric(std::size_t dimension) {
  return std::make_unique<NearestOfSet>(dimension);
}

}  // namespace fusionslam::detail
