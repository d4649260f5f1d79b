// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "prepared_view.hpp"

#include <algorithm>
#include <limits>

namespace fusionslam::detail {
namespace {

constexpr float radians = std::numbers::pi_v<float> / 180;
// Neighbours whose ranges differ by more than this and this share are of different surfaces.
constexpr float jump_m = 0.05f;
constexpr float jump_share = 0.1f;

using Vector = std::array<float, 3>;

Vector minus(const Vector& a, const Vector& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

/// The columns in view: all but the widest gap without points, if it is wide.
void find_columns(const RangeImage& image, PreparedView& view) {
  std::vector<bool> used(static_cast<std::size_t>(view.circle), false);
  for (const auto& cell : image.cells)
    used[static_cast<std::size_t>(((cell.column % view.circle) + view.circle) % view.circle)] =
        true;
  int widest = 0, after = 0, gap = 0;
  for (int i = 0; i < 2 * view.circle; ++i) {  // twice round, for a gap across the seam
    if (used[static_cast<std::size_t>(i % view.circle)]) {
      if (gap > widest) {
        widest = gap;
        after = i % view.circle;
      }
      gap = 0;
    } else {
      gap = std::min(gap + 1, view.circle);
    }
  }
  constexpr int hole_deg = 10;  // narrower gaps are holes in the view, not its end
  const bool full = widest * 360 < hole_deg * view.circle;
  view.first_column = full ? 0 : after;
  view.columns = full ? view.circle : view.circle - widest;
}

void place_points(const RangeImage& image, PreparedView& view) {
  const std::size_t count = image.cells.size();
  view.points.resize(count);
  view.ranges.resize(count);
  view.colors.resize(count);
  view.table.assign(static_cast<std::size_t>(view.rows * view.columns), PreparedView::nothing);
  for (std::size_t i = 0; i < count; ++i) {
    const RangeImage::Cell& cell = image.cells[i];
    const float azimuth = static_cast<float>(cell.column) / view.steps_per_rad_azimuth;
    const float elevation = static_cast<float>(cell.row) / view.steps_per_rad_elevation;
    const float range = static_cast<float>(cell.range * RangeImage::range_step);
    const float level = range * std::cos(elevation);
    view.ranges[i] = range;
    view.points[i] = {view.sensor[0] + level * std::cos(azimuth),
                      view.sensor[1] + level * std::sin(azimuth),
                      view.sensor[2] + range * std::sin(elevation)};
    for (std::size_t c = 0; c < 3; ++c) view.colors[i][c] = cell.color[c];
    const int place = (cell.row - view.first_row) * view.columns + view.column_of(cell.column);
    view.table[static_cast<std::size_t>(place)] = static_cast<int>(i);
  }
}

/// Difference of two neighbours on one surface, or of one of them and the middle; false if none.
bool tangent(const PreparedView& view, int middle, int before, int after, Vector& found) {
  const auto range = [&](int i) { return view.ranges[static_cast<std::size_t>(i)]; };
  const auto same = [&](int i) {
    return i >= 0 && std::fabs(range(i) - range(middle)) < jump_m + jump_share * range(middle);
  };
  const int low = same(before) ? before : middle, high = same(after) ? after : middle;
  found = minus(view.points[static_cast<std::size_t>(high)],
                view.points[static_cast<std::size_t>(low)]);
  return low != high;
}

void find_normals(PreparedView& view) {
  constexpr float none = std::numeric_limits<float>::quiet_NaN();
  view.normals.assign(view.size(), {none, none, none});
  for (int row = 0; row < view.rows; ++row) {
    for (int column = 0; column < view.columns; ++column) {
      const int i = view.at(row, column);
      Vector along, up{0, 0, 1};  // a row alone is taken for a wall
      if (i < 0 || !tangent(view, i, view.at(row, column - 1), view.at(row, column + 1), along))
        continue;
      if (!tangent(view, i, view.at(row - 1, column), view.at(row + 1, column), up)) up = {0, 0, 1};
      const Vector normal = cross(along, up);
      const float length =
          std::sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
      if (length < 1e-9f) continue;
      for (std::size_t c = 0; c < 3; ++c)
        view.normals[static_cast<std::size_t>(i)][c] = normal[c] / length;
    }
  }
}

}  // namespace

PreparedView prepare(const RangeImage& image) {
  PreparedView view;
  if (image.cells.empty()) return view;
  view.sensor = image.sensor;
  view.steps_per_rad_azimuth = 1 / (image.azimuth_step * radians);
  view.steps_per_rad_elevation = 1 / (image.elevation_step * radians);
  view.circle = std::max(1, static_cast<int>(std::lround(360 / image.azimuth_step)));
  const auto [low, high] =
      std::minmax_element(image.cells.begin(), image.cells.end(),
                          [](const auto& a, const auto& b) { return a.row < b.row; });
  view.first_row = low->row;
  view.rows = high->row - low->row + 1;
  find_columns(image, view);
  place_points(image, view);
  find_normals(view);
  return view;
}

}  // namespace fusionslam::detail
