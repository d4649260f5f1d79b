// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Rows of columns that go around in a circle, compared at all turns at once by their spectra over
// azimuth, which round: they say which rows, and which turns of them, are worth comparing exactly.
#pragma once

#include <cstddef>

#include "column_kernel.hpp"

namespace fusionslam::detail {

/// Floats of the real parts of frequency 0 to turns / 2, filled up to whole lanes.
constexpr std::size_t half_spectrum(std::size_t turns) { return whole_lanes(turns / 2 + 1); }

/// Floats of the spectrum of one ring: the real parts, then the imaginary ones.
constexpr std::size_t ring_spectrum(std::size_t turns) { return 2 * half_spectrum(turns); }

/// Bound of the error of TurnKernels::correlate for rows whose squares sum up to `energy`. The
/// products of two spectra sum up to at most turns x energy in magnitude (Cauchy, Parseval), which
/// the last step divides by the turns; fewer than 3.5 roundings a turn of 2^-24 and one a ring
/// follow one another.
constexpr double correlation_error(std::size_t turns, std::size_t bins, double energy) {
  return energy * (3.5 * static_cast<double>(turns) + static_cast<double>(bins)) * 0x1p-24;
}

struct TurnKernels {
  /// Writes the spectra over azimuth of `bins` rings.
  void (*transform)(const float* unit, std::size_t bins, float* spectrum);

  /// Writes ColumnKernels::dots() of all turns, but for correlation_error().
  void (*correlate)(const float* query_spectrum, const float* row_spectrum, std::size_t bins,
                    float* dots);
};

/// For 60 turns (Scan Context) and 120 (RING).
template <std::size_t turns>
TurnKernels turn_kernels(SimdLevel level);

extern template TurnKernels turn_kernels<60>(SimdLevel level);
extern template TurnKernels turn_kernels<120>(SimdLevel level);

}  // namespace fusionslam::detail
