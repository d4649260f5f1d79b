// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Decides by the alignment of range images whether two scenes show the same place.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "fusionslam/views/scene.hpp"

namespace fusionslam {

/// Parameters of the alignment.
struct AlignmentConfig {
  static constexpr const char* section = "alignment";

  int candidates = 24;
  int iterations = 8;
  int points = 150;
  double first_scale = 0.5;
  double last_scale = 0.1;
  double tolerance = 0.08;
  double reach = 0.6;
  double turn = 20.0;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("candidates", config.candidates,
            OptionInfo{"stored views that are aligned, those with the most similar thumbnails", "",
                       1, 1e6});
    visitor("iterations", config.iterations,
            OptionInfo{"Gauss-Newton steps from each start", "", 1, 1000});
    visitor(
        "points", config.points,
        OptionInfo{"cells of the current view that are compared with the stored one", "", 10, 1e5});
    visitor("first_scale", config.first_scale,
            OptionInfo{"distance weighted one half in the first step", "m", 1e-3, 10});
    visitor("last_scale", config.last_scale,
            OptionInfo{"distance weighted one half in the last step", "m", 1e-3, 10});
    visitor(
        "tolerance", config.tolerance,
        OptionInfo{"distance up to which surfaces agree, plus 1 % of the range", "m", 1e-3, 10});
    visitor("reach", config.reach,
            OptionInfo{"views farther apart are different views", "m", 0.01, 100});
    visitor(
        "turn", config.turn,
        OptionInfo{"views rotated by more against each other are different views", "deg", 1, 180});
  }
};

/// Features of an alignment, from which its probability is computed.
struct AlignmentEvidence {
  static constexpr std::size_t size = 12;
  static constexpr std::array<std::string_view, size> names{
      "agreeing", "behind", "before", "empty",     "color", "tint",
      "cells",    "error",  "grip",   "thumbnail", "shift", "turn"};
  std::array<double, size> values{};
};

/// Pose of one scene relative to another, and the probability that both show the same place.
struct Alignment {
  double x = 0;    ///< m, of the current robot in the frame of the stored one
  double y = 0;    ///< m
  double yaw = 0;  ///< rad
  /// Probability that the two scans were taken within 0.8 m and 22.9 deg of each other (the
  /// thesis's bounds for a correct match, Stastny 2022, 5.2); 0 if nothing could be aligned, or
  /// reach or turn is exceeded.
  double probability = 0;
  AlignmentEvidence evidence;
  /// Information of x, y, yaw in the frame of the stored robot, row-major, as if the residuals of
  /// the cells were independent; zeros if nothing could be aligned.
  std::array<double, 9> information{};
};

/// Aligns the range images of two scenes. A scene without one, or with fewer than ten cells, gives
/// probability 0.
Alignment align_scenes(const Scene& current, const Scene& stored,
                       const AlignmentConfig& config = {});

/// A stored scene that may show the current place.
struct AlignedScene {
  std::size_t number = 0;
  Alignment alignment;
};

/// Stored scenes, numbered from 0 in the order in which they were added; those most similar to the
/// current scene are aligned with it.
/// Threads may share it through const members while none changes it.
class AlignmentIndex {
 public:
  explicit AlignmentIndex(const AlignmentConfig& config = {});
  ~AlignmentIndex();
  AlignmentIndex(AlignmentIndex&&) noexcept;
  AlignmentIndex& operator=(AlignmentIndex&&) noexcept;

  /// Stores a scene and returns its number.
  std::size_t add(const Scene& scene);

  /// Forgets a scene; the numbers of all later ones fall by one. Throws ConfigError if there is no
  /// such number.
  void remove(std::size_t number);

  std::size_t size() const;
  const AlignmentConfig& config() const;
  /// The range image of a stored scene, all that is kept of it. Throws as remove().
  const RangeImage& image(std::size_t number) const;

  /// The candidates, most probable first, of equal ones the lowest number first. The result does
  /// not depend on the threads (0: one a core).
  std::vector<AlignedScene> query(const Scene& current, int threads = 1) const;

  /// As above, with at most `most` candidates: the scenes `near`, whatever their thumbnails, and
  /// those with the most similar thumbnails. Throws ConfigError for a number that is not stored.
  std::vector<AlignedScene> query_near(const Scene& current, const std::vector<std::size_t>& near,
                                       std::size_t most, int threads = 1) const;

 private:
  struct Storage;
  std::unique_ptr<Storage> scenes_;
};

}  // namespace fusionslam
