// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "turn_kernel.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "column_vectors.hpp"

namespace fusionslam::detail {
namespace {

/// Cosines and sines, column by column for transform(), frequency by frequency for correlate().
template <std::size_t turns>
struct Waves {
  static constexpr std::size_t frequencies = turns / 2 + 1;
  float forward[turns][ring_spectrum(turns)] = {};
  float cosines[frequencies][whole_lanes(turns)] = {};
  float sines[frequencies][whole_lanes(turns)] = {};

  Waves() {
    for (std::size_t f = 0; f < frequencies; ++f) {
      // Frequencies between the first and the last stand for their mirror images, too.
      const double weight = (f == 0 || f == frequencies - 1 ? 1.0 : 2.0) / turns;
      for (std::size_t i = 0; i < turns; ++i) {
        const double angle = 2 * std::numbers::pi * static_cast<double>(f * i % turns) / turns;
        forward[i][f] = static_cast<float>(std::cos(angle));
        forward[i][half_spectrum(turns) + f] = static_cast<float>(-std::sin(angle));
        cosines[f][i] = static_cast<float>(weight * std::cos(angle));
        sines[f][i] = static_cast<float>(weight * -std::sin(angle));
      }
    }
  }
};

template <std::size_t turns>
const Waves<turns> waves;

template <std::size_t turns>
FUSIONSLAM_INLINE void transform(const float* unit, std::size_t bins, float* spectrum) {
  constexpr std::size_t together = 8;  // vectors that registers hold
  constexpr std::size_t step = together * column_lanes;
  static_assert(ring_spectrum(turns) % step == 0);
  for (std::size_t ring = 0; ring < bins; ++ring)
    for (std::size_t f = 0; f < ring_spectrum(turns); f += step) {
      ColumnVector sums[together] = {};
      for (std::size_t i = 0; i < turns; ++i)
        for (std::size_t v = 0; v < together; ++v)
          sums[v] += unit[i * bins + ring] * load(waves<turns>.forward[i] + f + v * column_lanes);
      for (std::size_t v = 0; v < together; ++v)
        store(sums[v], spectrum + ring * ring_spectrum(turns) + f + v * column_lanes);
    }
}

/// Circular correlation by the product of the spectra.
template <std::size_t turns>
FUSIONSLAM_INLINE void correlate(const float* query, const float* row, std::size_t bins,
                                 float* dots) {
  constexpr std::size_t half = half_spectrum(turns), width = ring_spectrum(turns);
  float real[half], imaginary[half];
  for (std::size_t f = 0; f < half; f += column_lanes) {
    ColumnVector reals = {}, imaginaries = {};
    for (std::size_t ring = 0; ring < bins; ++ring) {
      const float* a = query + ring * width + f;
      const float* b = row + ring * width + f;
      const ColumnVector a_real = load(a), a_imaginary = load(a + half);
      const ColumnVector b_real = load(b), b_imaginary = load(b + half);
      reals += a_real * b_real + a_imaginary * b_imaginary;
      imaginaries += a_imaginary * b_real - a_real * b_imaginary;
    }
    store(reals, real + f);
    store(imaginaries, imaginary + f);
  }
  constexpr std::size_t vectors = whole_lanes(turns) / column_lanes;
  ColumnVector sums[vectors] = {};
  for (std::size_t f = 0; f < Waves<turns>::frequencies; ++f)
    for (std::size_t v = 0; v < vectors; ++v)
      sums[v] += real[f] * load(waves<turns>.cosines[f] + v * column_lanes) +
                 imaginary[f] * load(waves<turns>.sines[f] + v * column_lanes);
  float found[whole_lanes(turns)];
  for (std::size_t v = 0; v < vectors; ++v) store(sums[v], found + v * column_lanes);
  std::copy_n(found, turns, dots);
}

}  // namespace

template <std::size_t turns>
TurnKernels turn_kernels(SimdLevel level) {
  return {compiled_for<transform<turns>>(level), compiled_for<correlate<turns>>(level)};
}

template TurnKernels turn_kernels<60>(SimdLevel level);
template TurnKernels turn_kernels<120>(SimdLevel level);

}  // namespace fusionslam::detail
