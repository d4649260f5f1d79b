// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "fusionslam/views/scene.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "hull.hpp"

namespace fusionslam {
namespace {

/// Points and colours of one cluster.
struct Cluster {
  std::vector<float> points;
  std::array<std::vector<std::uint8_t>, 3> channels;

  std::size_t size() const { return channels[0].size(); }
  PointsView view() const { return {points.data(), size()}; }
};

std::vector<Cluster> clusters_of(PointsView points, ColorsView colors,
                                 const std::vector<std::int32_t>& labels) {
  std::vector<Cluster> clusters;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (labels[i] < 0) continue;
    const auto label = static_cast<std::size_t>(labels[i]);
    if (label >= clusters.size()) clusters.resize(label + 1);
    Cluster& cluster = clusters[label];
    cluster.points.insert(cluster.points.end(), points[i], points[i] + 3);
    for (int channel = 0; channel < 3; ++channel)
      cluster.channels[static_cast<std::size_t>(channel)].push_back(colors.at(i, channel));
  }
  return clusters;
}

double mean(const std::vector<std::uint8_t>& values) {
  std::uint64_t sum = 0;
  for (const std::uint8_t value : values) sum += value;
  return static_cast<double>(sum) / static_cast<double>(values.size());
}

/// The median, truncated to a whole number as the author's program does.
double median(const std::vector<std::uint8_t>& values) {
  std::array<std::size_t, 256> counts{};
  for (const std::uint8_t value : values) ++counts[value];
  const auto ranked = [&](std::size_t rank) {
    unsigned value = 0;
    for (std::size_t below = counts[0]; below <= rank; below += counts[value]) ++value;
    return value;
  };
  const unsigned middle = (ranked((values.size() - 1) / 2) + ranked(values.size() / 2)) / 2;
  return middle;
}

SceneObject object_of(const Cluster& cluster, const SceneConfig& config) {
  const detail::Shape shape = detail::shape_of(cluster.view());
  SceneObject object;
  object.volume = shape.hull.volume;
  object.area = shape.hull.area;
  object.extents = shape.extents;
  object.box_min = shape.box_min;
  object.box_max = shape.box_max;
  object.points = static_cast<std::int64_t>(cluster.size());
  for (std::size_t i = 0; i < 3; ++i) {
    object.center[i] = config.center == ObjectCenter::hull
                           ? shape.hull.centroid[i]
                           : (shape.box_min[i] + shape.box_max[i]) / 2;
    object.color[i] =
        config.color == ObjectColor::mean ? mean(cluster.channels[i]) : median(cluster.channels[i]);
  }
  return object;
}

/// The points off the plane z = 0.
ColoredCloud without_floor(PointsView points, ColorsView colors, float height) {
  ColoredCloud cloud;
  for (std::size_t i = 0; i < points.size; ++i) {
    if (std::fabs(points[i][2]) <= height) continue;
    cloud.points.insert(cloud.points.end(), points[i], points[i] + 3);
    for (int channel = 0; channel < 3; ++channel) cloud.colors.push_back(colors.at(i, channel));
    cloud.indices.push_back(static_cast<std::int64_t>(i));
  }
  return cloud;
}

}  // namespace

SceneConfig scene_preset(std::string_view name) {
  SceneConfig config;  // "robust"
  if (name == "paper") {
    config.color_scale = DbscanConfig{}.color_scale;
    config.min_size = 20;
    config.floor = 0;
    config.image = false;
  } else if (name == "author") {
    config.color_scale = DbscanConfig{}.color_scale;
    config.min_size = 1;
    config.floor = 0;
    config.image = false;
    config.center = ObjectCenter::box;
    config.color = ObjectColor::median;
  } else if (name != "robust") {
    throw ConfigError("preset is '" + std::string(name) +
                      "', expected one of robust, paper, author");
  }
  return config;
}

Scene build_scene(PointsView points, ColorsView colors, const SceneConfig& config) {
  validate(config);
  detail::check_colors(points, colors);
  detail::check_points(points, 0, "a scene");  // those of the floor, too, by their own numbers
  if (config.floor > 0) {
    SceneConfig rest = config;
    rest.floor = 0;
    const ColoredCloud cloud = without_floor(points, colors, static_cast<float>(config.floor));
    return build_scene(cloud.points_view(), cloud.colors_view(), rest);
  }
  Scene scene;
  for (const Cluster& cluster : clusters_of(points, colors, dbscan(points, colors, config))) {
    detail::check_interrupt();
    if (cluster.size() >= static_cast<std::size_t>(config.min_size))
      scene.objects.push_back(object_of(cluster, config));
  }
  std::stable_sort(scene.objects.begin(), scene.objects.end(),
                   [](const auto& a, const auto& b) { return a.points > b.points; });
  if (config.image) scene.image = range_image(points, colors, config);
  return scene;
}

}  // namespace fusionslam
