// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "flat_hull.hpp"

#include <algorithm>
#include <span>

namespace fusionslam::detail {
namespace {

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

/// One side of the hull of sorted points, its last point left out (Andrew 1979).
template <class Iterator>
void append_chain(Iterator begin, Iterator end, std::vector<Eigen::Vector2d>& hull) {
  const std::size_t first = hull.size();
  for (auto point = begin; point != end; ++point) {
    while (hull.size() >= first + 2 &&
           cross(hull.back() - hull[hull.size() - 2], *point - hull.back()) <= 0)
      hull.pop_back();
    hull.push_back(*point);
  }
  hull.pop_back();
}

}  // namespace

FlatHull flat_hull(std::vector<Eigen::Vector2d> points) {
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  });
  const Eigen::Vector2d first = points.front(), middle = (first + points.back()) / 2;
  std::vector<Eigen::Vector2d> hull;
  append_chain(points.begin(), points.end(), hull);
  append_chain(points.rbegin(), points.rend(), hull);
  FlatHull result{0, Eigen::Vector2d::Zero()};
  for (std::size_t i = 0; i + 1 < hull.size(); ++i) {
    const double area = cross(hull[i] - first, hull[i + 1] - first) / 2;
    result.area += area;
    result.centroid += area * (first + hull[i] + hull[i + 1]) / 3;
  }
  result.centroid = result.area > 0 ? (result.centroid / result.area).eval() : middle;
  return result;
}

}  // namespace fusionslam::detail
