// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Scan Contexts, compared at every turn: all turns at once by their spectra over azimuth, which
// round, and exactly for those that may be among the nearest.
#pragma once

#include <cstddef>

#include "../detail/simd.hpp"
#include "fusionslam/matching.hpp"

namespace fusionslam::detail {

constexpr std::size_t sectors = scan_context_sectors;

/// Floats summed side by side: part of the result, so the same on every level.
constexpr std::size_t turn_lanes = 8;

/// Floats of one ring's spectrum: the real parts of frequency 0 to 30, filled up to whole lanes,
/// then the imaginary ones.
constexpr std::size_t ring_spectrum = 64;

/// Bound of the error of TurnKernels::correlate, in sums of cosines. The products of two spectra
/// sum up to at most 60 x 60 in magnitude (Cauchy, Parseval), which the last step divides by 60;
/// fewer than 200 roundings of 2^-24 and one a ring follow one another.
constexpr double correlation_error(std::size_t bins) {
  return 60 * (200 + static_cast<double>(bins)) * 0x1p-24;
}

struct TurnKernels {
  /// Writes each of the 60 sectors of `values`, `bins` floats long, divided by its length, or
  /// zeros where that is 0, and returns how many are not. `unit` may not overlap `values`.
  std::size_t (*normalize)(const float* values, std::size_t bins, float* unit);

  /// Writes the spectra over azimuth of `bins` rings of unit sectors.
  void (*transform)(const float* unit, std::size_t bins, float* spectrum);

  /// The largest of dots(), but for correlation_error.
  float (*correlate)(const float* query_spectrum, const float* row_spectrum, std::size_t bins);

  /// dots[t] is the product of `row` with the floats of `query` from sector t on. `query` holds
  /// its sectors twice; `size` is that of a row, rounded up to whole lanes and filled with zeros.
  void (*dots)(const float* query, const float* row, std::size_t bins, std::size_t size,
               float* dots);
};

TurnKernels turn_kernels(SimdLevel level);

}  // namespace fusionslam::detail
