// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// One Scan Context against others, at every turn.
#pragma once

#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "nearest.hpp"
#include "row_chunks.hpp"
#include "turn_kernel.hpp"

namespace fusionslam::detail {

/// Throws ShapeError unless a descriptor of this length has whole sectors.
void check_sectors(std::size_t dimension);

/// Floats of what write_spectrum() writes of a descriptor.
std::size_t spectrum_size(std::size_t dimension);

/// Writes what rules most rows out: the number of sectors that are filled, then the spectra.
void write_spectrum(std::span<const float> descriptor, std::span<float> spectrum);

class TurnSearch {
 public:
  TurnSearch(std::span<const float> query, std::size_t k);

  /// Offers a row, whose spectrum is that of write_spectrum().
  void offer(std::size_t index, const float* row, const float* spectrum) {
    if (least_distance(spectrum) > nearest_worst_) return;
    const double distance = compare(row).first;
    nearest_.offer(static_cast<std::int64_t>(index), distance * distance);
    nearest_worst_ = std::sqrt(nearest_.worst());
  }
  std::vector<Match> matches() { return nearest_.matches(); }

  /// Distance to a row, and the sector of the query that its first sector looks like.
  std::pair<double, std::size_t> compare(const float* row);

 private:
  /// No turn brings a row nearer than this.
  double least_distance(const float* spectrum) const;

  std::size_t bins_;
  std::size_t size_;  ///< of a row, in whole lanes
  TurnKernels kernels_;
  NearestK nearest_;
  double nearest_worst_ = std::numeric_limits<double>::infinity();
  AlignedFloats query_;  ///< unit sectors, twice
  AlignedFloats row_;
  AlignedFloats spectrum_;
  std::size_t filled_;
};

/// nearest() and nearest_causal() of Scan Contexts; see BatchSearch for the arguments.
MatchTable search_turns(std::span<const float> queries, std::span<const float> rows,
                        std::size_t dimension, std::optional<std::size_t> window, std::size_t k,
                        int threads);

}  // namespace fusionslam::detail
