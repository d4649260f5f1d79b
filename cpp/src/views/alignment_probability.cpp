// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "alignment.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t size = AlignmentEvidence::size;
constexpr std::size_t terms = 1 + size + size * (size + 1) / 2;

// Limit of deviations from the mean: there were no data to fit to beyond, where squares dominate.
constexpr double most_deviations = 4;

/// Written by benchmarks/accuracy/alignment.py --write.
struct Weights {
  double mean[size];
  double scale[size];
  double weights[terms];  // constant, linear, then products i <= j
};

#include "alignment_weights.inc"

}  // namespace

double probability_of(const AlignmentEvidence& evidence) {
  double values[size];
  for (std::size_t i = 0; i < size; ++i)
    values[i] = std::clamp((evidence.values[i] - fitted.mean[i]) / fitted.scale[i],
                           -most_deviations, most_deviations);
  const double* weight = fitted.weights;
  double sum = *weight++;
  for (std::size_t i = 0; i < size; ++i) sum += *weight++ * values[i];
  for (std::size_t i = 0; i < size; ++i)
    for (std::size_t j = i; j < size; ++j) sum += *weight++ * values[i] * values[j];
  return 1 / (1 + std::exp(-sum));
}

}  // namespace fusionslam::detail
