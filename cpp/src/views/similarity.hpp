// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <vector>

#include "fusionslam/views/similarity.hpp"

namespace fusionslam::detail {

/// Properties of an object whose differences enter the terms.
struct ComparedObject {
  std::array<double, 3> color;    ///< color_coordinates()
  std::array<double, 3> center;   ///< m
  double volume;                  ///< m3
  double ratio;                   ///< volume / area, m; 0 without an area
  std::array<double, 3> extents;  ///< m
  double closeness;               ///< 1 / (1 + range_slack * range), of which the larger counts
  double weight;                  ///< number of points
};

/// One sigmoid: factor / (1 + exp(a (x - x0))).
struct Term {
  double x0, a, factor;
};

/// The sum of these is the similarity.
struct Terms {
  Term color, distance, volume, ratio, extent;
};

/// Throws ConfigError for values out of range or if all weights are 0.
Terms terms_of(const SimilarityConfig& config);

/// Throws DataError naming the object if a value of it is not finite, or it has no points.
std::vector<ComparedObject> compared_objects(const Scene& scene, const SimilarityConfig& config);

}  // namespace fusionslam::detail
