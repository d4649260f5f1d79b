// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Point-to-plane ICP with projective data association (Blais and Levine 1995) in the plane: x, y
// and yaw, from several starts. The best is judged by the parts of each view that the other should
// have seen.
#include "alignment.hpp"

#include <algorithm>
#include <optional>

#include "../detail/interrupt.hpp"
#include "thumbnail.hpp"

namespace fusionslam {
namespace detail {
namespace {

constexpr std::size_t fewest_cells = 10;
constexpr double range_share = 0.01;  // of the range, by which surfaces may differ more
constexpr double damping = 1e-3;      // a point, limits steps in unconstrained directions
constexpr double farthest_step = 3;   // m: beyond, the alignment has diverged
constexpr double widest_turn = 1.2;   // rad
constexpr double color_limit = 60;    // of 255: another colour is another colour

struct Pose {
  double x = 0, y = 0, yaw = 0;
};

constexpr Pose starts[] = {{-0.35, 0, -0.25}, {-0.35, 0, 0}, {-0.35, 0, 0.25},
                           {0.35, 0, -0.25},  {0.35, 0, 0},  {0.35, 0, 0.25}};

Pose inverse(const Pose& pose) {
  const double c = std::cos(pose.yaw), s = std::sin(pose.yaw);
  return {-(c * pose.x + s * pose.y), s * pose.x - c * pose.y, -pose.yaw};
}

/// Applies a pose to many points.
struct Mover {
  float c, s, x, y;
  explicit Mover(const Pose& pose)
      : c(static_cast<float>(std::cos(pose.yaw))),
        s(static_cast<float>(std::sin(pose.yaw))),
        x(static_cast<float>(pose.x)),
        y(static_cast<float>(pose.y)) {}
  std::array<float, 3> operator()(const std::array<float, 3>& p) const {
    return {c * p[0] - s * p[1] + x, s * p[0] + c * p[1] + y, p[2]};
  }
  std::array<float, 3> turned(const std::array<float, 3>& n) const {
    return {c * n[0] - s * n[1], s * n[0] + c * n[1], n[2]};
  }
};

float dot(const std::array<float, 3>& a, const std::array<float, 3>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

std::array<float, 3> minus(const std::array<float, 3>& a, const std::array<float, 3>& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

/// Normal equations of one Gauss-Newton step, upper triangle.
struct Normal {
  double h[6]{}, b[3]{};
  int used = 0;

  void add(const double jacobian[3], double error, double weight) {
    for (int i = 0, k = 0; i < 3; ++i) {
      for (int j = i; j < 3; ++j) h[k++] += weight * jacobian[i] * jacobian[j];
      b[i] -= weight * jacobian[i] * error;
    }
    ++used;
  }
  /// Smallest eigenvalue of the translation's information, the turn eliminated, a point.
  double grip(double points) const {
    const double turn = h[5] + 1e-9;
    const double xx = h[0] - h[2] * h[2] / turn, yy = h[3] - h[4] * h[4] / turn;
    const double xy = h[1] - h[2] * h[4] / turn;
    return (xx + yy - std::hypot(xx - yy, 2 * xy)) / 2 / points;
  }
  /// The step by Cramer's rule; none if the matrix is singular.
  std::optional<Pose> solve(double extra) const {
    const double xx = h[0] + extra, xy = h[1], xt = h[2], yy = h[3] + extra, yt = h[4],
                 tt = h[5] + 4 * extra;
    const double a = yy * tt - yt * yt, d = xt * yt - xy * tt, e = xy * yt - xt * yy;
    const double determinant = xx * a + xy * d + xt * e;
    if (!(std::fabs(determinant) > 1e-12)) return std::nullopt;
    const double f = xx * tt - xt * xt, g = xy * xt - xx * yt, i = xx * yy - xy * xy;
    return Pose{(a * b[0] + d * b[1] + e * b[2]) / determinant,
                (d * b[0] + f * b[1] + g * b[2]) / determinant,
                (e * b[0] + g * b[1] + i * b[2]) / determinant};
  }
};

/// Every nth cell, so that there are at most twice `most`.
std::vector<std::size_t> some_of(const PreparedView& view, std::size_t most) {
  std::vector<std::size_t> chosen;
  const std::size_t step = std::max<std::size_t>(1, view.size() / most);
  for (std::size_t i = 0; i < view.size(); i += step) chosen.push_back(i);
  return chosen;
}

Normal linearise(const PreparedView& current, const PreparedView& stored,
                 const std::vector<std::size_t>& chosen, const Pose& pose, double scale) {
  const Mover move(pose);
  Normal normal;
  for (const std::size_t i : chosen) {
    const std::array<float, 3> point = move(current.points[i]);
    int row, column;
    float range;
    stored.locate(point.data(), row, column, range);
    const int found = stored.at(row, column);
    if (found < 0 || !stored.has_normal(static_cast<std::size_t>(found))) continue;
    const auto j = static_cast<std::size_t>(found);
    const std::array<float, 3>& n = stored.normals[j];
    const double error = dot(n, minus(point, stored.points[j]));
    double weight = 1 / (1 + error * error / (scale * scale));
    weight *= weight;  // Geman-McClure
    if (current.has_normal(i)) {
      const double facing = dot(move.turned(current.normals[i]), n);
      weight *= facing * facing;
    }
    const double jacobian[3] = {n[0], n[1],
                                n[0] * (pose.y - point[1]) + n[1] * (point[0] - pose.x)};
    normal.add(jacobian, error, weight);
  }
  return normal;
}

struct Fit {
  Pose pose;
  double grip = 0;
  Normal normal;
};

std::optional<Fit> fit(const PreparedView& current, const PreparedView& stored,
                       const std::vector<std::size_t>& chosen, const Pose& start,
                       const AlignmentConfig& config) {
  Fit found{start, 0, {}};
  const auto points = static_cast<double>(chosen.size());
  for (int step = 0; step < config.iterations; ++step) {
    const double part = step / std::max(1.0, config.iterations - 1.0);
    const double scale =
        config.first_scale * std::pow(config.last_scale / config.first_scale, part);
    const Normal normal = linearise(current, stored, chosen, found.pose, scale);
    if (normal.used < 5) return std::nullopt;
    found.normal = normal;
    found.grip = normal.grip(points);
    const std::optional<Pose> change = normal.solve(damping * points);
    if (!change) return std::nullopt;
    found.pose = {found.pose.x + change->x, found.pose.y + change->y, found.pose.yaw + change->yaw};
    if (std::fabs(found.pose.x) > farthest_step || std::fabs(found.pose.y) > farthest_step ||
        std::fabs(found.pose.yaw) > widest_turn)
      return std::nullopt;
  }
  return found;
}

/// Counts of the points of one view by their relation to the other.
struct Tally {
  double agreeing = 0, behind = 0, before = 0, empty = 0;
  double color = 0, squares = 0;
  std::array<double, 3> tint{};

  double in_view() const { return agreeing + behind + before + empty; }
};

/// The nearest surface about a cell: its point's number, or none, and how far it is.
struct Nearest {
  int number = -1;
  float distance = 1e9f;
};

Nearest nearest_surface(const PreparedView& view, const std::array<float, 3>& point, int row,
                        int column, float range, double tolerance) {
  Nearest nearest;
  for (int r = row - 1; r <= row + 1; ++r) {
    for (int c = column - 1; c <= column + 1; ++c) {
      const int found = view.at(r, c);
      if (found < 0) continue;
      const auto j = static_cast<std::size_t>(found);
      const float apart = std::fabs(range - view.ranges[j]);
      float distance = apart;
      // Along the normal, unless the two are far apart on the ray and only the planes meet.
      if (view.has_normal(j) && apart <= 4 * tolerance + 0.1 * range)
        distance = std::fabs(dot(view.normals[j], minus(point, view.points[j])));
      if (distance < nearest.distance) nearest = {found, distance};
    }
  }
  return nearest;
}

/// Counts the points of `view` as seen by `other`; `sign` turns tints into those of one direction.
void look(const PreparedView& view, const PreparedView& other,
          const std::vector<std::size_t>& chosen, const Pose& pose, double tolerance, double sign,
          Tally& tally) {
  const Mover move(pose);
  for (const std::size_t i : chosen) {
    const std::array<float, 3> point = move(view.points[i]);
    int row, column;
    float range;
    other.locate(point.data(), row, column, range);
    const int there = other.at(row, column);
    if (there == PreparedView::outside) continue;
    const Nearest nearest = nearest_surface(other, point, row, column, range, tolerance);
    if (nearest.number >= 0 && nearest.distance < tolerance + range_share * range) {
      const auto& a = view.colors[i];
      const auto& b = other.colors[static_cast<std::size_t>(nearest.number)];
      double apart = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        apart += std::fabs(a[c] - b[c]);
        tally.tint[c] += sign * (a[c] - b[c]);
      }
      tally.agreeing += 1;
      tally.color += std::min(apart / 3, color_limit);
      tally.squares += nearest.distance * nearest.distance;
    } else if (there < 0) {
      tally.empty += nearest.number < 0 ? 1 : 0.5;  // half: the edge of what is seen
    } else if (range > other.ranges[static_cast<std::size_t>(there)]) {
      tally.behind += 1;
    } else {
      tally.before += 1;
    }
  }
}

/// The normal equations at a residual of no less than the steps of ranges.
std::array<double, 9> information_of(const Tally& tally, const Normal& normal) {
  const double variance = std::max(tally.squares / std::max(1.0, tally.agreeing),
                                   RangeImage::range_step * RangeImage::range_step);
  const double* h = normal.h;
  std::array<double, 9> information{h[0], h[1], h[2], h[1], h[3], h[4], h[2], h[4], h[5]};
  for (double& value : information) value /= variance;
  return information;
}

double score_of(const Tally& tally) {
  return (tally.agreeing - 0.5 * tally.color / color_limit) / std::max(1.0, tally.in_view());
}

AlignmentEvidence evidence_of(const Tally& tally, const Fit& fit, float thumbnail) {
  const double seen = std::max(1.0, tally.in_view()), agreeing = std::max(1.0, tally.agreeing);
  const double tint =
      (std::fabs(tally.tint[0]) + std::fabs(tally.tint[1]) + std::fabs(tally.tint[2])) / 3;
  return {{tally.agreeing / seen, tally.behind / seen, tally.before / seen, tally.empty / seen,
           tally.color / agreeing, tint / agreeing, std::log(agreeing),
           std::sqrt(tally.squares / agreeing), std::log(std::max(fit.grip, 1e-5)), thumbnail,
           std::hypot(fit.pose.x, fit.pose.y), std::fabs(fit.pose.yaw)}};
}

}  // namespace

Alignment align_views(const PreparedView& current, const PreparedView& stored, float thumbnail,
                      const AlignmentConfig& config) {
  Alignment best;
  if (current.size() < fewest_cells || stored.size() < fewest_cells) return best;
  const auto points = static_cast<std::size_t>(config.points);
  const auto few = some_of(current, points);
  const auto mine = some_of(current, 2 * points), theirs = some_of(stored, 2 * points);
  double best_score = -1;
  for (const Pose& start : starts) {
    check_interrupt();
    const std::optional<Fit> found = fit(current, stored, few, start, config);
    if (!found) continue;
    Tally tally;
    look(current, stored, mine, found->pose, config.tolerance, 1, tally);
    look(stored, current, theirs, inverse(found->pose), config.tolerance, -1, tally);
    if (score_of(tally) <= best_score) continue;
    best_score = score_of(tally);
    best = {found->pose.x,
            found->pose.y,
            found->pose.yaw,
            0,
            evidence_of(tally, *found, thumbnail),
            information_of(tally, found->normal)};
  }
  const bool near = std::hypot(best.x, best.y) <= config.reach &&
                    std::fabs(best.yaw) * 180 / std::numbers::pi <= config.turn;
  if (best_score >= 0 && near) best.probability = probability_of(best.evidence);
  return best;
}

}  // namespace detail

Alignment align_scenes(const Scene& current, const Scene& stored, const AlignmentConfig& config) {
  validate(config);
  const float thumbnail = detail::thumbnail_distance(detail::thumbnail_of(current.image),
                                                     detail::thumbnail_of(stored.image));
  if (!std::isfinite(thumbnail)) return {};
  return detail::align_views(detail::prepare(current.image), detail::prepare(stored.image),
                             thumbnail, config);
}

}  // namespace fusionslam
