// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Scan Context++ (Kim, Choi, Kim, T-RO 2022): the norms of the columns, the aligning key, tell
// which shifts are worth comparing; there the columns' cosines count as in a Scan Context.
#include <array>
#include <cmath>

#include "../column_kernel.hpp"
#include "../row_chunks.hpp"
#include "metrics.hpp"
#include "turn_metric.hpp"

namespace fusionslam::detail {
namespace {

/// Columns of a row in a cycle of as many, or longer by empty columns: then what is shifted over
/// one end does not come back at the other before the rows are apart.
struct Shifts {
  const char* name;
  std::size_t columns;
  std::size_t cycle;
  std::size_t reach;  ///< shifts compared to each side of the best one of the aligning keys
  bool is_turn;
};

constexpr Shifts polar{"aligned_polar", 60, 60, 6, true};
constexpr Shifts cartesian{"aligned_cartesian", 40, 80, 4, false};

constexpr std::size_t largest_cycle = 80, largest_reach = 6;

/// Of a row: unit columns, how many of them are filled, and the 1-norms of the columns.
struct Prepared {
  const float* unit;
  std::size_t filled;
  const float* key;
};

class AlignedColumns final : public RowMetric {
 public:
  AlignedColumns(std::size_t dimension, const Shifts& shifts)
      : RowMetric(dimension), shifts_(shifts) {
    check_multiple(shifts.name, dimension, shifts.columns);
  }

  /// Number of filled columns, aligning key, unit columns.
  std::size_t cache_size() const override { return unit_begin() + size(); }

  void prepare(std::span<const float> row, std::span<float> cache) const override {
    cache[0] =
        static_cast<float>(write_unit_columns(row, shifts_.columns, cache.subspan(unit_begin())));
    for (std::size_t column = 0; column < shifts_.columns; ++column) {
      const float* values = row.data() + column * bins();
      cache[column_lanes + column] = static_cast<float>(sum_in_lanes(
          bins(), [&](std::size_t i) { return std::abs(static_cast<double>(values[i])); }));
    }
  }

  std::unique_ptr<RowQuery> query(std::span<const float> row) const override;

  Prepared prepared(const float* cache) const {
    return {cache + unit_begin(), static_cast<std::size_t>(cache[0]), cache + column_lanes};
  }
  const Shifts& shifts() const { return shifts_; }
  std::size_t bins() const { return dimension() / shifts_.columns; }
  std::size_t size() const { return whole_lanes(dimension()); }

 private:
  std::size_t unit_begin() const { return column_lanes + whole_lanes(shifts_.columns); }

  const Shifts& shifts_;
};

class AlignedQuery final : public RowQuery {
 public:
  AlignedQuery(const AlignedColumns& metric, std::span<const float> row)
      : metric_(metric),
        kernels_(column_kernels(simd_level())),
        cache_(metric.cache_size()),
        unit_(repeated_columns() * metric.bins() + metric.size()) {
    metric.prepare(row, cache_);
    const Prepared query = metric.prepared(cache_.data());
    const Shifts& shifts = metric.shifts();
    for (std::size_t begin = 0; begin < repeated_columns(); begin += shifts.cycle) {
      const std::size_t count = std::min(shifts.columns, repeated_columns() - begin);
      std::copy_n(query.unit, count * metric.bins(), unit_.data() + begin * metric.bins());
    }
    filled_ = query.filled;
    std::copy_n(query.key, shifts.columns, key_.begin());
    std::copy_n(key_.begin(), shifts.cycle, key_.begin() + shifts.cycle);
  }

  Distance compare(const Candidate& candidate) override {
    const Shifts& shifts = metric_.shifts();
    const Prepared row = metric_.prepared(candidate.cache);
    const std::size_t first = (align(row.key) + shifts.cycle - shifts.reach) % shifts.cycle;
    float dots[2 * largest_reach + 1];
    const std::size_t count = 2 * shifts.reach + 1;
    kernels_.dots(unit_.data() + first * metric_.bins(), row.unit, metric_.bins(), metric_.size(),
                  count, dots);
    const float* best = std::max_element(dots, dots + count);
    const std::size_t filled = std::max(filled_, row.filled);
    const double cosine = filled > 0 ? static_cast<double>(*best) / static_cast<double>(filled) : 0;
    const std::size_t shift = (first + static_cast<std::size_t>(best - dots)) % shifts.cycle;
    return {std::max(0.0, 1 - cosine),
            shifts.is_turn ? std::optional(yaw_of(shift, shifts.cycle, 2 * std::numbers::pi))
                           : std::nullopt};
  }

 private:
  std::size_t repeated_columns() const {
    return 2 * metric_.shifts().cycle + 2 * metric_.shifts().reach;
  }

  /// The shift at which the aligning keys are nearest by L2, the lowest of equal ones.
  std::size_t align(const float* key) const {
    const std::size_t cycle = metric_.shifts().cycle;
    std::array<float, largest_cycle> other{};
    std::copy_n(key, metric_.shifts().columns, other.begin());
    std::size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t shift = 0; shift < cycle; ++shift) {
      const double square = sum_in_lanes(cycle, [&](std::size_t i) {
        const double difference =
            static_cast<double>(key_[i + shift]) - static_cast<double>(other[i]);
        return difference * difference;
      });
      if (square < least) {
        least = square;
        best = shift;
      }
    }
    return best;
  }

  const AlignedColumns& metric_;
  ColumnKernels kernels_;
  AlignedFloats cache_;
  AlignedFloats unit_;  ///< unit columns of two cycles and what the reach adds
  std::size_t filled_ = 0;
  std::array<float, 2 * largest_cycle> key_{};
};

std::unique_ptr<RowQuery> AlignedColumns::query(std::span<const float> row) const {
  return std::make_unique<AlignedQuery>(*this, row);
}

}  // namespace

MetricPointer aligned_polar_metric(std::size_t dimension) {
  return std::make_unique<AlignedColumns>(dimension, polar);
}

MetricPointer aligned_cartesian_metric(std::size_t dimension) {
  return std::make_unique<AlignedColumns>(dimension, cartesian);
}

}  // namespace fusionslam::detail
