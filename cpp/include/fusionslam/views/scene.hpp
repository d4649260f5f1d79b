// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Builds scenes, which are lists of objects, from coloured clouds (Stastny 2022, 4.5).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"
#include "fusionslam/views/range_image.hpp"

namespace fusionslam {

/// Parameters of DBSCAN in (x, y, z, s r, s g, s b).
struct DbscanConfig {
  static constexpr const char* section = "dbscan";

  double eps = 0.6;
  int min_points = 10;
  double color_scale = 0.001;
  bool inclusive = false;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("eps", config.eps, OptionInfo{"radius of a neighbourhood", "m", 1e-6, 1e6});
    visitor("min_points", config.min_points,
            OptionInfo{"neighbours that make a point a core point (itself included)", "", 1, 1e9});
    visitor("color_scale", config.color_scale,
            OptionInfo{"distance that one step of a colour channel stands for", "m", 0, 1e3});
    visitor("inclusive", config.inclusive,
            OptionInfo{"count a point exactly eps away as a neighbour"});
  }
};

/// Cluster of each point, -1 for noise: clusters are numbered in the order of their first core
/// point. A border point goes to the first cluster that reaches it. Memory is linear in the number
/// of points. Without colours `colors` is empty and the distance is that of x, y, z.
/// Throws DataError for NaN and infinity, ShapeError if there is not one colour a point,
/// ConfigError for values out of range (Ester, Kriegel, Sander, Xu 1996).
std::vector<std::int32_t> dbscan(PointsView points, ColorsView colors,
                                 const DbscanConfig& config = {});

/// A convex hull. Flat point sets have volume 0 and the area of the flat hull (counted once);
/// points on a line, or equal ones, have neither.
struct Hull {
  double volume = 0;                 ///< m3
  double area = 0;                   ///< m2
  std::array<double, 3> centroid{};  ///< of the solid; of the flat hull; of the line
};

/// The convex hull of at least one point, by Qhull. Throws DataError for none, NaN or infinity.
Hull convex_hull(PointsView points);

enum class ObjectCenter { hull, box };

template <>
struct ChoiceNames<ObjectCenter> {
  static constexpr std::array<std::string_view, 2> value{"hull", "box"};
};

enum class ObjectColor { mean, median };

template <>
struct ChoiceNames<ObjectColor> {
  static constexpr std::array<std::string_view, 2> value{"mean", "median"};
};

/// Parameters of build_scene; the defaults are those of the "robust" preset.
struct SceneConfig : DbscanConfig, RangeImageConfig {
  static constexpr const char* section = "scene";

  int min_size = 10;
  ObjectCenter center = ObjectCenter::hull;
  ObjectColor color = ObjectColor::mean;
  double floor = 0.1;
  bool image = true;

  /// Of the scales measured in the warehouse and in a simulated house, the greatest that costs
  /// nothing: colours 300 bytes apart separate objects that touch.
  SceneConfig() { color_scale = 0.002; }

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    DbscanConfig::visit(config, visitor);
    visitor("min_size", config.min_size,
            OptionInfo{"fewest points that make a cluster an object", "", 1, 1e9});
    visitor("center", config.center, OptionInfo{"centre of an object: of its hull or of its box"});
    visitor("color", config.color,
            OptionInfo{"colour of an object: mean of its points, or their median, truncated"});
    visitor("floor", config.floor,
            OptionInfo{"leave out points no farther than this from z = 0, a robot's floor; 0 "
                       "keeps all",
                       "m", 0, 1e3});
    visitor("image", config.image,
            OptionInfo{"keep a range image in the scene, which alignment needs"});
    RangeImageConfig::visit(config, visitor);
  }
};

/// "paper": the text of the thesis, with centres of hulls and mean colours; it names no smallest
/// size, here 20 points. "author": its program, with centres of boxes, truncated medians and no
/// size filter. "robust", the default: a colour scale that separates touching objects, no floor,
/// and a range image for the alignment. Throws ConfigError for any other name.
SceneConfig scene_preset(std::string_view name);

/// One object of a scene: a cluster and its convex hull.
struct SceneObject {
  std::array<double, 3> center{};   ///< m, in the frame of the cloud: of the hull or of the box
  double volume = 0;                ///< of the hull, m3
  double area = 0;                  ///< of the hull, m2
  std::array<double, 3> color{};    ///< RGB, 0 to 255: mean, or median
  std::array<double, 3> extents{};  ///< m, along the cluster's own principal axes, longest first
  std::array<double, 3> box_min{};  ///< m
  std::array<double, 3> box_max{};  ///< m
  std::int64_t points = 0;
};

/// The objects of a cloud: those with most points first, of equally many the one whose first core
/// point comes first in the cloud.
struct Scene {
  std::vector<SceneObject> objects;
  RangeImage image{};  ///< without cells if the configuration asks for none
};

/// The objects of a cloud (Stastny 2022, 4.5). A cloud without clusters, or without points, gives a
/// scene without objects. Throws DataError for NaN and infinity, ShapeError if there is not one
/// colour a point, ConfigError for values out of range.
Scene build_scene(PointsView points, ColorsView colors, const SceneConfig& config = {});

/// Encodes a scene in about 25 bytes an object and 12 a scene. Similarities under every preset stay
/// within 1e-4: centres and extents are kept to 0.05 mm, volumes to 0.01 dm3, areas to 1 cm2,
/// colours to 1/2048 of a byte, numbers of points exactly. Boxes are not kept. The range
/// image, if it is wanted and there is one, is kept exactly, in about two bytes a cell. Throws
/// DataError for values that do not fit, such as centres beyond 4e11 m.
std::vector<std::uint8_t> scene_to_bytes(const Scene& scene, bool with_image = true);

/// The scene that scene_to_bytes wrote. Throws DataError if the bytes are cut, damaged, foreign or
/// of another version.
Scene scene_from_bytes(std::span<const std::uint8_t> bytes);

}  // namespace fusionslam
