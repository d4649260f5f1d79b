// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "hull.hpp"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <vector>

#include "../detail/checks.hpp"
#include "flat_hull.hpp"
#include "solid_hull.hpp"

namespace fusionslam {
namespace {

using Eigen::Vector3d;

/// Points that lay in a plane before their coordinates became floats lie at most so far apart
/// across it, relative to the largest coordinate: sqrt(3) roundings of half a step, on both sides.
constexpr double flat_thickness = 3e-7;

/// Points moved and scaled into [-1, 1]: huge and tiny coordinates are all the same then.
struct Normalized {
  Eigen::Matrix3Xd points;
  Vector3d origin;
  double scale;      // m; 1 if all points are equal
  double thickness;  // up to which the points count as flat

  Vector3d restore(const Vector3d& point) const { return origin + scale * point; }
};

Normalized normalize(PointsView points, const Vector3d& low, const Vector3d& high) {
  Normalized result;
  result.origin = low + (high - low) / 2;
  result.scale = (high - low).maxCoeff() / 2;
  if (!(result.scale > 0)) result.scale = 1;
  result.thickness = flat_thickness *
                     std::max(low.cwiseAbs().maxCoeff(), high.cwiseAbs().maxCoeff()) / result.scale;
  result.points.resize(3, static_cast<Eigen::Index>(points.size));
  for (std::size_t i = 0; i < points.size; ++i) {
    const Vector3d point(points[i][0], points[i][1], points[i][2]);
    result.points.col(static_cast<Eigen::Index>(i)) = (point - result.origin) / result.scale;
  }
  return result;
}

/// Directions in which points are spread, and how far, longest first.
struct Spread {
  Eigen::Matrix3d axes;  // columns
  Vector3d extents;
};

Spread spread_of(const Eigen::Matrix3Xd& points) {
  const Vector3d mean = points.rowwise().mean();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const Vector3d away = points.col(i) - mean;
    covariance += away * away.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  const Eigen::Matrix3d& found = solver.eigenvectors();
  Vector3d low = found.transpose() * points.col(0), high = low;
  for (Eigen::Index i = 1; i < points.cols(); ++i) {
    const Vector3d along = found.transpose() * points.col(i);
    low = low.cwiseMin(along);
    high = high.cwiseMax(along);
  }
  std::array<Eigen::Index, 3> order{2, 1, 0};
  std::stable_sort(order.begin(), order.end(),
                   [&](auto a, auto b) { return high[a] - low[a] > high[b] - low[b]; });
  Spread spread;
  for (Eigen::Index i = 0; i < 3; ++i) {
    const Eigen::Index from = order[static_cast<std::size_t>(i)];
    spread.axes.col(i) = found.col(from);
    spread.extents[i] = high[from] - low[from];
  }
  return spread;
}

Hull flat_shape(const Eigen::Matrix3Xd& points, const Spread& spread, double thickness) {
  std::vector<Eigen::Vector2d> projected;
  for (Eigen::Index i = 0; i < points.cols(); ++i)
    projected.emplace_back(spread.axes.leftCols<2>().transpose() * points.col(i));
  if (spread.extents[1] <= thickness)
    for (Eigen::Vector2d& point : projected) point.y() = 0;
  const detail::FlatHull flat = detail::flat_hull(std::move(projected));
  const double level = spread.axes.col(2).dot(points.rowwise().mean());
  Hull hull;
  hull.area = flat.area;
  Vector3d::Map(hull.centroid.data()) =
      spread.axes.leftCols<2>() * flat.centroid + level * spread.axes.col(2);
  return hull;
}

Hull normalized_hull(Normalized& cloud, const Spread& spread) {
  if (spread.extents[2] > cloud.thickness)
    if (const auto solid = detail::solid_hull(cloud.points)) return *solid;
  return flat_shape(cloud.points, spread, cloud.thickness);
}

}  // namespace

detail::Shape detail::shape_of(PointsView points) {
  Vector3d low(points[0][0], points[0][1], points[0][2]), high = low;
  for (std::size_t i = 1; i < points.size; ++i) {
    const Vector3d point(points[i][0], points[i][1], points[i][2]);
    low = low.cwiseMin(point);
    high = high.cwiseMax(point);
  }
  Normalized cloud = normalize(points, low, high);
  const Spread spread = spread_of(cloud.points);
  Shape shape;
  shape.hull = normalized_hull(cloud, spread);
  shape.hull.volume *= cloud.scale * cloud.scale * cloud.scale;
  shape.hull.area *= cloud.scale * cloud.scale;
  Vector3d::Map(shape.hull.centroid.data()) =
      cloud.restore(Vector3d::Map(shape.hull.centroid.data()));
  Vector3d::Map(shape.extents.data()) = cloud.scale * spread.extents;
  Vector3d::Map(shape.box_min.data()) = low;
  Vector3d::Map(shape.box_max.data()) = high;
  return shape;
}

Hull convex_hull(PointsView points) {
  detail::check_points(points, 1, "a convex hull");
  return detail::shape_of(points).hull;
}

}  // namespace fusionslam
