// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "fusionslam/simd.hpp"
#include "fusionslam/views/similarity.hpp"
#include "similarity.hpp"

namespace fusionslam::detail {

/// The objects of all scenes, column by column, scene after scene.
struct StoredScenes {
  explicit StoredScenes(const SimilarityConfig& how) : config(how), terms(terms_of(how)) {}

  /// In the place of a stored scene, or after the last one.
  void put(std::size_t scene, const std::vector<ComparedObject>& objects);
  void remove(std::size_t scene);

  SimilarityConfig config;
  Terms terms;
  std::vector<std::size_t> ends;  ///< of each scene, among the objects
  std::array<std::vector<double>, 3> color, center, extents;
  std::vector<double> volume, ratio;
  std::vector<float> closeness, weight;

  std::size_t size() const { return ends.size(); }
  std::size_t begin_of(std::size_t scene) const { return scene == 0 ? 0 : ends[scene - 1]; }
};

/// Similarities of the scenes from `begin` to `end`, at one SIMD level.
void compare_scenes(const StoredScenes& stored, const std::vector<ComparedObject>& current,
                    std::size_t begin, std::size_t end, SimdLevel level, double* result);

}  // namespace fusionslam::detail
