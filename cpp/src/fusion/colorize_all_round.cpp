// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "exposure.hpp"
#include "fusionslam/fusion.hpp"
#include "pixel_color.hpp"
#include "projection.hpp"

namespace fusionslam {
namespace {

constexpr std::uint8_t nobody = 255;

/// The camera that sees a point nearest to its image's centre, as far as is known.
struct Seen {
  float distance = std::numeric_limits<float>::infinity();
  detail::Color color{};
  std::uint8_t camera = nobody;
};

void check(const std::vector<CameraView>& cameras) {
  if (cameras.empty() || cameras.size() >= nobody + std::size_t{1})
    throw DataError(std::to_string(cameras.size()) + " cameras, expected 1 to " +
                    std::to_string(nobody));
  for (const CameraView& camera : cameras) {
    detail::check_projection(camera.projection);
    detail::check_image(camera.image);
  }
}

/// Squared distance to the image's centre, across in half widths, down in half heights.
float distance_to_center(ImageView image, const detail::Pixel& pixel) {
  const double across = (2 * pixel.u + 1) / image.width - 1;
  const double down = (2 * pixel.v + 1) / image.height - 1;
  return static_cast<float>(across * across + down * down);
}

/// Lets one more camera colour the points that it sees better than all before. `exposures` gets the
/// colours of points that it and the best one before see.
void look(PointsView points, const CameraView& camera, std::uint8_t number,
          Interpolation interpolation, std::vector<Seen>& seen, detail::Exposures& exposures) {
  const ImageView image = camera.image;
  detail::for_each_visible(points, camera.projection, image.width, image.height,
                           [&](std::size_t i, const detail::Pixel& pixel) {
                             const Seen found{distance_to_center(image, pixel),
                                              detail::read_color(image, pixel, interpolation),
                                              number};
                             Seen& best = seen[i];
                             if (best.camera != nobody)
                               exposures.add(best.camera, best.color, number, found.color);
                             if (found.distance < best.distance) best = found;
                           });
}

/// What becomes of each byte of each channel of a camera.
using Table = std::array<std::array<std::uint8_t, 256>, 3>;

Table table_of(const detail::Gains& gains) {
  Table table{};
  for (std::size_t channel = 0; channel < 3; ++channel)
    for (std::size_t value = 0; value < 256; ++value)
      table[channel][value] = static_cast<std::uint8_t>(
          std::min(255.0, static_cast<double>(value) * gains[channel] + 0.5));
  return table;
}

/// The points that somebody saw, with balanced colours.
void collect(PointsView points, const std::vector<Seen>& seen, AllRoundCloud& result) {
  std::vector<Table> tables;
  tables.reserve(result.gains.size());
  for (const detail::Gains& gains : result.gains) tables.push_back(table_of(gains));
  const auto size = static_cast<std::size_t>(std::count_if(
      seen.begin(), seen.end(), [](const Seen& point) { return point.camera != nobody; }));
  ColoredCloud& cloud = result.cloud;
  cloud.points.resize(3 * size);
  cloud.colors.resize(3 * size);
  cloud.indices.resize(size);
  result.cameras.resize(size);
  std::size_t k = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    if (seen[i].camera == nobody) continue;
    const Table& table = tables[seen[i].camera];
    std::copy_n(points[i], 3, cloud.points.data() + 3 * k);
    for (std::size_t channel = 0; channel < 3; ++channel)
      cloud.colors[3 * k + channel] = table[channel][seen[i].color[channel]];
    cloud.indices[k] = static_cast<std::int64_t>(i);
    result.cameras[k++] = seen[i].camera;
  }
}

}  // namespace

AllRoundCloud colorize_all_round(PointsView points, const std::vector<CameraView>& cameras,
                                 bool balance, Interpolation interpolation) {
  check(cameras);
  std::vector<Seen> seen(points.size);
  detail::Exposures exposures(cameras.size());
  for (std::size_t k = 0; k < cameras.size(); ++k)
    look(points, cameras[k], static_cast<std::uint8_t>(k), interpolation, seen, exposures);
  AllRoundCloud result;
  result.gains = balance ? exposures.gains()
                         : std::vector<detail::Gains>(cameras.size(), detail::Gains{1, 1, 1});
  collect(points, seen, result);
  return result;
}

}  // namespace fusionslam
