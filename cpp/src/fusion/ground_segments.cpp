// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Ground plane fitting (Zermas, Izzat, Papanikolopoulos, ICRA 2017, section III.A), and the
// treatment of segments without ground.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <span>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "fusionslam/fusion.hpp"
#include "up_axis.hpp"

namespace fusionslam {
namespace {

/// A point seen by the algorithm: along the driving axis, to the side, and up, in metres.
struct Point {
  float forward, side, height;
};

/// Numbers of the coordinates forward, to the side and up.
struct Directions {
  std::size_t forward, side;
  detail::Axis up;

  Point point(const float* p) const {
    return {p[forward], p[side], static_cast<float>(up.sign) * p[up.coordinate]};
  }
};

Directions directions_of(UpAxis up, DrivingAxis driving) {
  const detail::Axis axis = detail::axis_of(up);
  const auto forward = static_cast<std::size_t>(driving);
  if (forward == axis.coordinate)
    throw ConfigError("segments.driving is '" + std::string(choice_name(driving)) +
                      "', which is the axis that points up");
  return {forward, 3 - forward - axis.coordinate, axis};
}

/// normal . point + offset = 0, the normal of length 1 and pointing up.
struct Plane {
  Eigen::Vector3d normal;
  double offset;
  std::size_t support;  ///< how many points it was fitted to
  double support_side;  ///< their mean, to the side

  double distance(const Point& p) const {
    return normal[0] * p.forward + normal[1] * p.side + normal[2] * p.height + offset;
  }
  double height(double forward, double side) const {
    return -(normal[0] * forward + normal[1] * side + offset) / normal[2];
  }
};

/// Sums from which mean and covariance follow, relative to one of the points.
class Moments {
 public:
  explicit Moments(const Point& pivot) : pivot_(pivot) {}

  void add(const Point& p) {
    const double x = double{p.forward} - pivot_.forward, y = double{p.side} - pivot_.side,
                 z = double{p.height} - pivot_.height;
    ++count_;
    sums_[0] += x, sums_[1] += y, sums_[2] += z;
    products_[0] += x * x, products_[1] += x * y, products_[2] += x * z;
    products_[3] += y * y, products_[4] += y * z, products_[5] += z * z;
  }

  /// The plane of least squared distances; nothing if the points do not spread along two axes at
  /// least three times as far as across the plane.
  std::optional<Plane> plane() const {
    if (count_ < 3) return std::nullopt;
    const auto n = static_cast<double>(count_);
    const Eigen::Vector3d mean = Eigen::Map<const Eigen::Vector3d>(sums_) / n;
    Eigen::Matrix3d covariance;
    covariance << products_[0], products_[1], products_[2], products_[1], products_[3],
        products_[4], products_[2], products_[4], products_[5];
    covariance = covariance / n - mean * mean.transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
    const Eigen::Vector3d& spread = solver.eigenvalues();  // ascending
    if (!(spread[1] > 9 * spread[0] && spread[1] > 1e-6 * spread[2])) return std::nullopt;
    Eigen::Vector3d normal = solver.eigenvectors().col(0);
    if (normal[2] < 0) normal = -normal;
    const Eigen::Vector3d pivot(pivot_.forward, pivot_.side, pivot_.height);
    return Plane{normal, -normal.dot(mean + pivot), count_, mean[1] + pivot_.side};
  }

 private:
  Point pivot_;
  std::size_t count_ = 0;
  double sums_[3] = {};
  double products_[6] = {};
};

constexpr std::size_t points_between_checks = 1 << 16;

/// The plane of the points that `is_ground` accepts.
template <class Predicate>
std::optional<Plane> plane_of(std::span<const Point> points, Predicate&& is_ground) {
  Moments moments(points.front());
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i % points_between_checks == 0) detail::check_interrupt();
    if (is_ground(points[i])) moments.add(points[i]);
  }
  return moments.plane();
}

/// Height of the lowest points: the paper's lowest point representative, but their median instead
/// of their mean, so that a few ghosts below the floor do not move it.
double lowest_height(std::span<const Point> points, std::size_t count) {
  std::vector<float> heights(points.size());
  std::transform(points.begin(), points.end(), heights.begin(),
                 [](const Point& p) { return p.height; });
  const auto at = [&](std::size_t i) { return heights.begin() + static_cast<std::ptrdiff_t>(i); };
  std::nth_element(heights.begin(), at(count - 1), heights.end());
  std::nth_element(heights.begin(), at(count / 2), at(count));
  return heights[count / 2];
}

/// Number of points that count as the lowest.
std::size_t lowest_count(std::size_t points, const GroundSegmentsConfig& config) {
  const double share = config.lowest_share * static_cast<double>(points);
  return std::max(static_cast<std::size_t>(config.lowest), static_cast<std::size_t>(share));
}

/// The ground of one segment by itself (the paper's algorithm 1).
std::optional<Plane> fit(std::span<const Point> points, const GroundSegmentsConfig& config) {
  const std::size_t lowest = lowest_count(points.size(), config);
  if (points.size() < lowest) return std::nullopt;
  const double base = lowest_height(points, lowest);
  auto plane = plane_of(
      points, [&](const Point& p) { return std::fabs(p.height - base) < config.seed_height; });
  // Half the distance: the feet of walls, which are as near to the floor, would lift the plane.
  for (int i = 1; i < config.iterations && plane; ++i)
    plane = plane_of(points, [&, current = *plane](const Point& p) {
      return std::fabs(current.distance(p)) < 0.5 * config.distance;
    });
  const double least_up = std::cos(config.max_tilt * std::numbers::pi / 180);
  if (plane && plane->normal[2] < least_up) return std::nullopt;
  return plane;
}

/// The cloud cut across the driving axis into segments of one length.
struct Cut {
  std::vector<double> borders;       ///< segments + 1
  std::vector<std::size_t> starts;   ///< of each segment in `points`, and their end
  std::vector<Point> points;         ///< segment after segment
  std::vector<std::size_t> indices;  ///< of the same points in the cloud

  std::size_t segments() const { return starts.size() - 1; }
  std::span<const Point> segment(std::size_t s) const {
    return std::span(points).subspan(starts[s], starts[s + 1] - starts[s]);
  }
};

std::vector<double> borders_of(PointsView points, std::size_t forward, std::size_t segments) {
  double first = points.size ? points[0][forward] : 0;
  double last = first;
  for (std::size_t i = 1; i < points.size; ++i) {
    first = std::min<double>(first, points[i][forward]);
    last = std::max<double>(last, points[i][forward]);
  }
  std::vector<double> borders(segments + 1);
  for (std::size_t s = 0; s <= segments; ++s)
    borders[s] = std::lerp(first, last, static_cast<double>(s) / static_cast<double>(segments));
  return borders;
}

Cut cut(PointsView points, const Directions& directions, std::size_t segments) {
  Cut result;
  result.borders = borders_of(points, directions.forward, segments);
  const double first = result.borders.front(), length = result.borders.back() - first;
  const double scale = length > 0 ? static_cast<double>(segments) / length : 0;
  std::vector<std::size_t> segment_of(points.size);
  result.starts.resize(segments + 1);
  for (std::size_t i = 0; i < points.size; ++i) {
    const double place = (points[i][directions.forward] - first) * scale;
    segment_of[i] = std::min(static_cast<std::size_t>(place), segments - 1);
    ++result.starts[segment_of[i] + 1];
  }
  std::partial_sum(result.starts.begin(), result.starts.end(), result.starts.begin());
  auto next = result.starts;
  result.points.resize(points.size);
  result.indices.resize(points.size);
  for (std::size_t i = 0; i < points.size; ++i) {
    const std::size_t place = next[segment_of[i]]++;
    result.points[place] = directions.point(points[i]);
    result.indices[place] = i;
  }
  return result;
}

/// The nearer neighbour's plane for a segment that has none or whose plane leaves a step.
void borrow(std::optional<Plane>& plane, const Plane& neighbor, double border, double max_step) {
  if (plane) {
    const double side = plane->support_side;
    const double step = plane->height(border, side) - neighbor.height(border, side);
    if (std::fabs(step) <= max_step) return;
  }
  plane = neighbor;
}

/// The planes of all segments: those of their own, checked from the one with most ground outwards.
/// One plane a segment; if none has any, that of the whole cloud, if it has one.
std::vector<std::optional<Plane>> planes_of(const Cut& cloud, const GroundSegmentsConfig& config) {
  std::vector<std::optional<Plane>> planes(cloud.segments());
  std::size_t best = 0;
  const auto support = [&](std::size_t s) { return planes[s] ? planes[s]->support : 0; };
  for (std::size_t s = 0; s < planes.size(); ++s) {
    planes[s] = fit(cloud.segment(s), config);
    if (support(s) > support(best)) best = s;
  }
  if (!planes[best]) return {planes.size(), fit(cloud.points, config)};
  for (std::size_t s = best + 1; s < planes.size(); ++s)
    borrow(planes[s], *planes[s - 1], cloud.borders[s], config.max_step);
  for (std::size_t s = best; s-- > 0;)
    borrow(planes[s], *planes[s + 1], cloud.borders[s + 1], config.max_step);
  return planes;
}

std::array<double, 4> coefficients_of(const Plane& plane, const Directions& directions) {
  std::array<double, 4> coefficients{};
  coefficients[directions.forward] = plane.normal[0];
  coefficients[directions.side] = plane.normal[1];
  coefficients[directions.up.coordinate] = directions.up.sign * plane.normal[2];
  coefficients[3] = plane.offset;
  return coefficients;
}

std::vector<std::int64_t> above(const Cut& cloud, const std::vector<std::optional<Plane>>& planes,
                                double distance) {
  std::vector<std::uint8_t> is_ground(cloud.points.size());
  for (std::size_t s = 0; s < planes.size(); ++s)
    for (std::size_t k = cloud.starts[s]; planes[s] && k < cloud.starts[s + 1]; ++k)
      is_ground[cloud.indices[k]] = planes[s]->distance(cloud.points[k]) < distance;
  std::vector<std::int64_t> kept;
  for (std::size_t i = 0; i < is_ground.size(); ++i)
    if (!is_ground[i]) kept.push_back(static_cast<std::int64_t>(i));
  return kept;
}

}  // namespace

GroundSegments remove_ground_segments(PointsView points, UpAxis up,
                                      const GroundSegmentsConfig& config) {
  validate(config);
  detail::check_points(points, 0, "ground removal");
  const Directions directions = directions_of(up, config.driving);
  Cut cloud = cut(points, directions, static_cast<std::size_t>(config.segments));
  const auto planes = planes_of(cloud, config);
  GroundSegments ground;
  for (const auto& plane : planes)
    ground.planes.push_back(plane ? coefficients_of(*plane, directions) : std::array<double, 4>{});
  ground.kept = above(cloud, planes, config.distance);
  ground.borders = std::move(cloud.borders);
  return ground;
}

}  // namespace fusionslam
