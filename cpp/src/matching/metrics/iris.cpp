// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// LiDAR Iris (Wang et al., IROS 2020, section III-D): the share of the bits valid in both that
// differ, at the turn where it is least. The paper takes the turn from a phase correlation; here
// all 360 are compared.
#include <cmath>
#include <cstring>
#include <vector>

#include "../bit_kernel.hpp"
#include "fusionslam/errors.hpp"
#include "metrics.hpp"
#include "turn_metric.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t turns = 360;
constexpr std::size_t float_bits = 16;  // of each value of a row

using WordVector = std::vector<std::uint64_t, LineAllocator<std::uint64_t>>;
typedef std::uint64_t CachedWord __attribute__((may_alias));

/// Each column of a row is bits, as many as its mask that follows. Packed, all columns' bits come
/// first, then all masks.
class Iris final : public RowMetric {
 public:
  explicit Iris(std::size_t dimension) : RowMetric(dimension) {
    check_multiple("iris", dimension, 2 * turns);
  }

  void check(std::span<const float> row, std::size_t number) const override {
    for (std::size_t i = 0; i < row.size(); ++i)
      if (!(row[i] >= 0 && row[i] <= 65535 && row[i] == std::floor(row[i])))
        throw DataError("descriptor " + std::to_string(number) + " is " + std::to_string(row[i]) +
                        " at position " + std::to_string(i) +
                        ", metric iris takes 16 bits a value, whole numbers from 0 to 65535");
  }

  std::size_t cache_size() const override { return 2 * words() * sizeof(std::uint64_t) / 4; }

  void prepare(std::span<const float> row, std::span<float> cache) const override {
    WordVector packed(2 * words());
    const std::size_t half = dimension() / (2 * turns);
    for (std::size_t column = 0; column < turns; ++column)
      for (std::size_t i = 0; i < half; ++i) {
        const float* bits = row.data() + column * 2 * half + i;
        const std::size_t word = column * column_words() + i / 4, shift = float_bits * (i % 4);
        packed[word] |= static_cast<std::uint64_t>(*bits) << shift;
        packed[words() + word] |= static_cast<std::uint64_t>(bits[half]) << shift;
      }
    std::memcpy(cache.data(), packed.data(), packed.size() * sizeof(std::uint64_t));
  }

  std::unique_ptr<RowQuery> query(std::span<const float> row) const override;

  std::size_t column_words() const { return (dimension() / (2 * turns) + 3) / 4; }

  /// Words of the bits of all columns, in whole blocks.
  std::size_t words() const {
    return (turns * column_words() + bit_block - 1) / bit_block * bit_block;
  }
};

class IrisQuery final : public RowQuery {
 public:
  IrisQuery(const Iris& metric, std::span<const float> query)
      : words_(metric.words()),
        column_words_(metric.column_words()),
        count_(bit_kernel(simd_level())),
        bits_(turns * column_words_ + words_),
        mask_(bits_.size()) {
    AlignedFloats cache(metric.cache_size());
    metric.prepare(query, cache);
    const std::size_t used = turns * column_words_;
    for (const std::size_t begin : {std::size_t{0}, used}) {
      std::memcpy(bits_.data() + begin, cache.data(), used * sizeof(std::uint64_t));
      std::memcpy(mask_.data() + begin, cache.data() + cache.size() / 2,
                  used * sizeof(std::uint64_t));
    }
  }

  Distance compare(const Candidate& candidate) override {
    const auto* row = reinterpret_cast<const CachedWord*>(candidate.cache);
    double least = 1;
    std::size_t best = 0;
    for (std::size_t turn = 0; turn < turns; ++turn) {
      const std::size_t begin = turn * column_words_;
      const auto [valid, differing] =
          count_(bits_.data() + begin, mask_.data() + begin, row, row + words_, words_);
      if (valid == 0) continue;
      const double share = static_cast<double>(differing) / static_cast<double>(valid);
      if (share < least) {
        least = share;
        best = turn;
      }
    }
    return {least, yaw_of(best, turns, 2 * std::numbers::pi)};
  }

 private:
  std::size_t words_;
  std::size_t column_words_;
  CountBits count_;
  WordVector bits_;  ///< twice
  WordVector mask_;  ///< twice
};

std::unique_ptr<RowQuery> Iris::query(std::span<const float> row) const {
  return std::make_unique<IrisQuery>(*this, row);
}

}  // namespace

MetricPointer iris_metric(std::size_t dimension) { return std::make_unique<Iris>(dimension); }

}  // namespace fusionslam::detail
