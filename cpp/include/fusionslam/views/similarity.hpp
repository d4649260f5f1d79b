// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Similarity of two scenes, object by object (Stastny 2022, 4.6), and of one scene to many.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/views/scene.hpp"

namespace fusionslam {

/// Metrics of colour: cie76 and ciede2000 in L*a*b* with white D65, rgb the Euclidean distance of
/// the bytes, author sqrt(3) |difference of red|.
enum class ColorDifference { cie76, ciede2000, rgb, author };

template <>
struct ChoiceNames<ColorDifference> {
  static constexpr std::array<std::string_view, 4> value{"cie76", "ciede2000", "rgb", "author"};
};

/// Difference of two RGB colours, channels 0 to 255. Throws DataError for channels outside.
double color_difference(const std::array<double, 3>& a, const std::array<double, 3>& b,
                        ColorDifference kind);

/// CIEDE2000 of two colours (L, a, b), with all weighting factors 1 (Sharma, Wu, Dalal 2005,
/// eqs. 2 to 22). Throws DataError for NaN or infinity.
double ciede2000(const std::array<double, 3>& a, const std::array<double, 3>& b);

/// Terms of the similarity of two objects. Each difference x counts as 1 / (1 + exp(a (x - x0))),
/// times its weight; the defaults are those of the "robust" preset.
struct SimilarityConfig {
  static constexpr const char* section = "similarity";

  ColorDifference color_difference = ColorDifference::cie76;
  double color_x0 = 3;
  double color_a = 1;
  double color_weight = 1;
  double distance_x0 = 0.4;
  double distance_a = 8;
  double distance_weight = 2;
  double volume_x0 = 0.1;
  double volume_a = 16;
  double volume_weight = 0;
  double ratio_x0 = 0.1;
  double ratio_a = 16;
  double ratio_weight = 0;
  double extent_x0 = 0.3;
  double extent_a = 5;
  double extent_weight = 1;
  double range_slack = 0.3;
  bool symmetric = true;
  bool normalized = true;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    const auto number = [&](const char* name, auto& value, const char* help, const char* unit) {
      visitor(name, value, OptionInfo{help, unit, 0, 1e6});
    };
    visitor("color_difference", config.color_difference,
            OptionInfo{"colour difference: of L*a*b*, of bytes, or of red alone"});
    number("color_x0", config.color_x0, "colour difference that counts half", "");
    number("color_a", config.color_a, "steepness of the colour term", "");
    number("color_weight", config.color_weight, "weight of the colour term", "");
    number("distance_x0", config.distance_x0, "distance of centres that counts half", "m");
    number("distance_a", config.distance_a, "steepness of the distance term", "1/m");
    number("distance_weight", config.distance_weight, "weight of the distance term", "");
    number("volume_x0", config.volume_x0, "difference of volumes that counts half", "m3");
    number("volume_a", config.volume_a, "steepness of the volume term", "1/m3");
    number("volume_weight", config.volume_weight, "weight of the volume term", "");
    number("ratio_x0", config.ratio_x0, "difference of volume / area that counts half", "m");
    number("ratio_a", config.ratio_a, "steepness of the ratio term", "1/m");
    number("ratio_weight", config.ratio_weight, "weight of the ratio term", "");
    number("extent_x0", config.extent_x0,
           "difference of the extents along own axes that counts half", "m");
    number("extent_a", config.extent_a, "steepness of the extent term", "1/m");
    number("extent_weight", config.extent_weight, "weight of the extent term", "");
    number("range_slack", config.range_slack,
           "how much more distances and extents may differ per metre from the robot, as a share",
           "1/m");
    visitor("symmetric", config.symmetric,
            OptionInfo{"compare in both directions: each scene's objects with the other's"});
    visitor("normalized", config.normalized,
            OptionInfo{"divide each term by its value at no difference, which makes "
                       "a scene exactly like itself"});
  }
};

/// The values of a preset: "robust" (ours, the default), "paper" or "author" (Stastny 2022, text
/// and program, both with the published parameters). Throws ConfigError for another name.
SimilarityConfig similarity_preset(std::string_view name);

/// Similarity of two objects, 0 to 1. Throws ConfigError for values out of range or if all weights
/// are 0, DataError for objects that are not finite, without points, or with invalid colours.
double object_similarity(const SceneObject& a, const SceneObject& b,
                         const SimilarityConfig& config = {});

/// Similarity of two scenes, 0 to 1: the best similarity of each object of the current scene to
/// one of the stored scene, averaged with the numbers of points as weights; if symmetric, the mean
/// of that and its counterpart. It is 1 for two empty scenes, and 0 for an empty
/// and another one. Throws as object_similarity.
double scene_similarity(const Scene& current, const Scene& stored,
                        const SimilarityConfig& config = {});

/// The content of a SceneIndex.
struct SceneIndexState {
  static constexpr std::size_t columns = 13;

  std::vector<std::uint64_t> ends;  ///< of each scene's objects among all
  std::vector<double> values;       ///< of all objects, column by column
};

/// Many stored scenes, compared with one in a single call. Numbered from 0 in the order in which
/// they were added. Threads may share it through const members while none changes it.
class SceneIndex {
 public:
  /// Throws ConfigError as object_similarity.
  explicit SceneIndex(const SimilarityConfig& config = {});
  ~SceneIndex();
  SceneIndex(SceneIndex&&) noexcept;
  SceneIndex& operator=(SceneIndex&&) noexcept;

  /// Stores a scene and returns its number. Throws DataError as object_similarity.
  std::size_t add(const Scene& scene);

  /// Puts a scene in the place of a stored one. Throws ConfigError if there is no such number.
  void replace(std::size_t number, const Scene& scene);

  /// Forgets a scene; the numbers of all later ones fall by one. Throws as replace.
  void remove(std::size_t number);

  std::size_t size() const;
  const SimilarityConfig& config() const;

  /// What it holds, to send to another process.
  SceneIndexState state() const;
  /// Takes over a state; the configuration stays, and must be that of the state's index. Throws
  /// DataError for an impossible one; the index is then unchanged.
  void restore(const SceneIndexState& state);

  /// scene_similarity(current, stored) of every stored scene, to 1e-6 (the hot loop is float).
  /// The result does not depend on the threads (0: one a core).
  std::vector<double> similarities(const Scene& current, int threads = 1) const;

 private:
  struct Storage;
  std::unique_ptr<Storage> scenes_;
};

}  // namespace fusionslam
