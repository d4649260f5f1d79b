// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "turn_kernel.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

namespace fusionslam::detail {
namespace {

constexpr std::size_t half_spectrum = ring_spectrum / 2;
constexpr std::size_t frequencies = sectors / 2 + 1;
constexpr std::size_t padded_turns = 64;

typedef float Vector __attribute__((vector_size(turn_lanes * sizeof(float)), may_alias));
typedef Vector Unaligned __attribute__((aligned(4)));

// By reference: a vector is returned in other registers where there are wider ones.
FUSIONSLAM_INLINE const Unaligned& load(const float* values) {
  return *reinterpret_cast<const Unaligned*>(values);
}

FUSIONSLAM_INLINE void store(const Vector& vector, float* values) {
  *reinterpret_cast<Unaligned*>(values) = vector;
}

FUSIONSLAM_INLINE float sum_of(const Vector& vector) {
  float sums[turn_lanes];
  std::memcpy(sums, &vector, sizeof(sums));
  for (std::size_t half = turn_lanes / 2; half > 0; half /= 2)
    for (std::size_t lane = 0; lane < half; ++lane) sums[lane] += sums[lane + half];
  return sums[0];
}

/// Cosines and sines, sector by sector for transform(), frequency by frequency for correlate().
struct Waves {
  float forward[sectors][ring_spectrum] = {};
  float cosines[frequencies][padded_turns] = {};
  float sines[frequencies][padded_turns] = {};

  Waves() {
    for (std::size_t f = 0; f < frequencies; ++f) {
      // Frequencies between the first and the last stand for their mirror images, too.
      const double weight = (f == 0 || f == frequencies - 1 ? 1.0 : 2.0) / sectors;
      for (std::size_t i = 0; i < sectors; ++i) {
        const double angle = 2 * std::numbers::pi * static_cast<double>(f * i % sectors) / sectors;
        forward[i][f] = static_cast<float>(std::cos(angle));
        forward[i][half_spectrum + f] = static_cast<float>(-std::sin(angle));
        cosines[f][i] = static_cast<float>(weight * std::cos(angle));
        sines[f][i] = static_cast<float>(weight * -std::sin(angle));
      }
    }
  }
};

const Waves waves;

// In double: squares of floats neither overflow nor vanish there.
FUSIONSLAM_INLINE std::size_t normalize(const float* values, std::size_t bins, float* unit) {
  std::size_t filled = 0;
  for (std::size_t sector = 0; sector < sectors; ++sector, values += bins, unit += bins) {
    double sum = 0;
    for (std::size_t i = 0; i < bins; ++i)
      sum += static_cast<double>(values[i]) * static_cast<double>(values[i]);
    const double factor = sum > 0 ? 1 / std::sqrt(sum) : 0;
    for (std::size_t i = 0; i < bins; ++i)
      unit[i] = static_cast<float>(static_cast<double>(values[i]) * factor);
    filled += sum > 0 ? 1 : 0;
  }
  return filled;
}

FUSIONSLAM_INLINE void transform(const float* unit, std::size_t bins, float* spectrum) {
  constexpr std::size_t vectors = ring_spectrum / turn_lanes;
  for (std::size_t ring = 0; ring < bins; ++ring) {
    Vector sums[vectors] = {};
    for (std::size_t i = 0; i < sectors; ++i)
      for (std::size_t v = 0; v < vectors; ++v)
        sums[v] += unit[i * bins + ring] * load(waves.forward[i] + v * turn_lanes);
    for (std::size_t v = 0; v < vectors; ++v)
      store(sums[v], spectrum + ring * ring_spectrum + v * turn_lanes);
  }
}

/// The largest of a circular correlation, by the product of its spectra.
FUSIONSLAM_INLINE float correlate(const float* query, const float* row, std::size_t bins) {
  float real[half_spectrum], imaginary[half_spectrum];
  for (std::size_t f = 0; f < half_spectrum; f += turn_lanes) {
    Vector reals = {}, imaginaries = {};
    for (std::size_t ring = 0; ring < bins; ++ring) {
      const float* a = query + ring * ring_spectrum + f;
      const float* b = row + ring * ring_spectrum + f;
      const Vector a_real = load(a), a_imaginary = load(a + half_spectrum);
      const Vector b_real = load(b), b_imaginary = load(b + half_spectrum);
      reals += a_real * b_real + a_imaginary * b_imaginary;
      imaginaries += a_imaginary * b_real - a_real * b_imaginary;
    }
    store(reals, real + f);
    store(imaginaries, imaginary + f);
  }
  Vector sums[padded_turns / turn_lanes] = {};
  for (std::size_t f = 0; f < frequencies; ++f)
    for (std::size_t v = 0; v < padded_turns / turn_lanes; ++v)
      sums[v] += real[f] * load(waves.cosines[f] + v * turn_lanes) +
                 imaginary[f] * load(waves.sines[f] + v * turn_lanes);
  float turns[padded_turns];
  for (std::size_t v = 0; v < padded_turns / turn_lanes; ++v)
    store(sums[v], turns + v * turn_lanes);
  return *std::max_element(turns, turns + sectors);
}

FUSIONSLAM_INLINE void dots(const float* query, const float* row, std::size_t bins,
                            std::size_t size, float* dots) {
  constexpr std::size_t together = 6;
  static_assert(sectors % together == 0);
  for (std::size_t turn = 0; turn < sectors; turn += together) {
    Vector sums[together] = {};
    const float* from = query + turn * bins;
    for (std::size_t i = 0; i < size; i += turn_lanes) {
      const Vector values = load(row + i);
      for (std::size_t t = 0; t < together; ++t) sums[t] += load(from + t * bins + i) * values;
    }
    for (std::size_t t = 0; t < together; ++t) dots[turn + t] = sum_of(sums[t]);
  }
}

}  // namespace

TurnKernels turn_kernels(SimdLevel level) {
  return {compiled_for<normalize>(level), compiled_for<transform>(level),
          compiled_for<correlate>(level), compiled_for<dots>(level)};
}

}  // namespace fusionslam::detail
