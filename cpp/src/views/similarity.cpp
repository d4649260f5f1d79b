// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The similarity as it is defined, in double precision; similarity_kernel.cpp is its fast twin.
#include "similarity.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "../detail/interrupt.hpp"
#include "color_difference.hpp"
#include "fusionslam/errors.hpp"

namespace fusionslam {
namespace {

using detail::ComparedObject;
using detail::Term;
using detail::Terms;

double value_at(const Term& term, double difference) {
  return term.factor / (1 + std::exp(term.a * (difference - term.x0)));
}

double total_weight(const SimilarityConfig& config) {
  const double total = config.color_weight + config.distance_weight + config.volume_weight +
                       config.ratio_weight + config.extent_weight;
  if (!(total > 0))
    throw ConfigError(
        "similarity: color_weight, distance_weight, volume_weight, ratio_weight and extent_weight "
        "are all 0, expected one above 0");
  return total;
}

/// Up to one rounding above 1, which scenes cut off.
double similarity_of(const ComparedObject& a, const ComparedObject& b, const Terms& terms,
                     ColorDifference color) {
  const double closeness = std::max(a.closeness, b.closeness);
  return value_at(terms.color, detail::coordinate_difference(a.color, b.color, color)) +
         value_at(terms.distance, closeness * detail::length_of_difference(a.center, b.center)) +
         value_at(terms.volume, std::abs(a.volume - b.volume)) +
         value_at(terms.ratio, std::abs(a.ratio - b.ratio)) +
         value_at(terms.extent, closeness * detail::length_of_difference(a.extents, b.extents));
}

using Objects = std::vector<ComparedObject>;

/// The best of each object in the other scene, weighted by its number of points.
double best_matches_mean(const Objects& current, const Objects& stored, const Terms& terms,
                         ColorDifference color) {
  double sum = 0, total = 0;
  for (const auto& object : current) {
    detail::check_interrupt();
    double best = 0;
    for (const auto& other : stored)
      best = std::max(best, similarity_of(object, other, terms, color));
    sum += object.weight * best;
    total += object.weight;
  }
  return sum / total;
}

[[noreturn]] void refuse(std::size_t object, const std::string& what) {
  throw DataError("object " + std::to_string(object) + " of the scene: " + what);
}

void check_finite(std::size_t i, const char* name, const std::array<double, 3>& values) {
  for (const double value : values)
    if (!std::isfinite(value))
      refuse(i, std::string(name) + " holds " + std::to_string(value) + ", expected numbers");
}

void check(std::size_t i, const SceneObject& object) {
  check_finite(i, "center", object.center);
  check_finite(i, "extents", object.extents);
  check_finite(i, "volume, area and color", {object.volume, object.area, object.color[0]});
  for (const double channel : object.color)
    if (!(channel >= 0 && channel <= 255))
      refuse(i, "color holds " + std::to_string(channel) + ", expected 0 to 255");
  if (object.points < 1)
    refuse(i, "points is " + std::to_string(object.points) + ", expected at least 1");
}

ComparedObject compared_object(const SceneObject& object, const SimilarityConfig& config) {
  const double range = std::hypot(object.center[0], object.center[1]);
  return {detail::color_coordinates(object.color, config.color_difference),
          object.center,
          object.volume,
          object.area > 0 ? object.volume / object.area : 0,
          object.extents,
          1 / (1 + config.range_slack * range),
          static_cast<double>(object.points)};
}

}  // namespace

namespace detail {

Terms terms_of(const SimilarityConfig& config) {
  validate(config);
  const double total = total_weight(config);
  const auto term = [&](double x0, double a, double weight) {
    const double at_zero = config.normalized ? 1 / (1 + std::exp(-a * x0)) : 1;
    return Term{x0, a, weight / total / at_zero};
  };
  return {term(config.color_x0, config.color_a, config.color_weight),
          term(config.distance_x0, config.distance_a, config.distance_weight),
          term(config.volume_x0, config.volume_a, config.volume_weight),
          term(config.ratio_x0, config.ratio_a, config.ratio_weight),
          term(config.extent_x0, config.extent_a, config.extent_weight)};
}

std::vector<ComparedObject> compared_objects(const Scene& scene, const SimilarityConfig& config) {
  std::vector<ComparedObject> objects;
  objects.reserve(scene.objects.size());
  for (std::size_t i = 0; i < scene.objects.size(); ++i) {
    check(i, scene.objects[i]);
    objects.push_back(compared_object(scene.objects[i], config));
  }
  return objects;
}

}  // namespace detail

SimilarityConfig similarity_preset(std::string_view name) {
  if (name == "robust") return {};
  if (name != "paper" && name != "author")
    throw ConfigError("preset is '" + std::string(name) +
                      "', expected one of paper, author, robust");
  SimilarityConfig config;
  config.color_difference = name == "paper" ? ColorDifference::cie76 : ColorDifference::author;
  config.color_x0 = 1.58773;
  config.color_a = 22.3013;
  config.color_weight = 0.0406;
  config.distance_x0 = 0.221766;
  config.distance_a = 4.691886;
  config.distance_weight = 0.82588;
  config.volume_x0 = 0.026518;
  config.volume_a = 15.95429;
  config.volume_weight = 0.058236;
  config.ratio_x0 = 11.919109;
  config.ratio_a = 7.489252;
  config.ratio_weight = 0.79746627;
  config.extent_weight = 0;
  config.range_slack = 0;
  config.symmetric = false;
  config.normalized = false;
  return config;
}

double object_similarity(const SceneObject& a, const SceneObject& b,
                         const SimilarityConfig& config) {
  const Terms terms = detail::terms_of(config);
  const Objects first = detail::compared_objects({{a}, {}}, config);
  const Objects second = detail::compared_objects({{b}, {}}, config);
  return std::min(1.0, similarity_of(first[0], second[0], terms, config.color_difference));
}

double scene_similarity(const Scene& current, const Scene& stored, const SimilarityConfig& config) {
  const Terms terms = detail::terms_of(config);
  const Objects first = detail::compared_objects(current, config);
  const Objects second = detail::compared_objects(stored, config);
  if (first.empty() || second.empty()) return first.empty() && second.empty() ? 1 : 0;
  const ColorDifference color = config.color_difference;
  const double forward = best_matches_mean(first, second, terms, color);
  const double both =
      config.symmetric ? (forward + best_matches_mean(second, first, terms, color)) / 2 : forward;
  return std::min(1.0, both);
}

}  // namespace fusionslam
