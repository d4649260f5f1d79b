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

/// A camera that looks for its points block by block.
class Looker {
 public:
  Looker(const CameraView& camera, std::uint8_t number, Interpolation interpolation)
      : image_(camera.image),
        region_(camera.projection, image_.width, image_.height),
        number_(number),
        interpolation_(interpolation),
        half_widths_(2.0 / image_.width),
        half_heights_(2.0 / image_.height) {}

  /// Colours what it sees better, of the block from `begin` on, than the cameras before it.
  /// `exposures` gets the colours of points that it and the best one before see.
  void look(PointsView points, std::size_t begin, Seen* seen, detail::Exposures& exposures) const {
    region_.for_each_visible(points, begin, [&](std::size_t i, const detail::Pixel& pixel) {
      const Seen found{distance_to_center(pixel), detail::read_color(image_, pixel, interpolation_),
                       number_};
      Seen& best = seen[i - begin];
      if (best.camera != nobody) exposures.add(best.camera, best.color, number_, found.color);
      if (found.distance < best.distance) best = found;
    });
  }

 private:
  /// Squared, across in half widths, down in half heights.
  float distance_to_center(const detail::Pixel& pixel) const {
    const double across = (pixel.u + 0.5) * half_widths_ - 1;
    const double down = (pixel.v + 0.5) * half_heights_ - 1;
    return static_cast<float>(across * across + down * down);
  }

  ImageView image_;
  detail::ImageRegion region_;
  std::uint8_t number_;
  Interpolation interpolation_;
  double half_widths_, half_heights_;
};

void resize(AllRoundCloud& result, std::size_t size) {
  result.cloud.points.resize(3 * size);
  result.cloud.colors.resize(3 * size);
  result.cloud.indices.resize(size);
  result.cameras.resize(size);
}

/// Writes the points of a block that somebody saw from place `size` on; returns the next place.
std::size_t collect(PointsView points, std::size_t begin, const Seen* seen, std::size_t size,
                    AllRoundCloud& result) {
  const std::size_t count = std::min(detail::point_block, points.size - begin);
  for (std::size_t k = 0; k < count; ++k) {
    if (seen[k].camera == nobody) continue;
    std::copy_n(points[begin + k], 3, result.cloud.points.data() + 3 * size);
    std::copy_n(seen[k].color.data(), 3, result.cloud.colors.data() + 3 * size);
    result.cloud.indices[size] = static_cast<std::int64_t>(begin + k);
    result.cameras[size++] = seen[k].camera;
  }
  return size;
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

void apply_gains(AllRoundCloud& result) {
  std::vector<Table> tables;
  tables.reserve(result.gains.size());
  for (const detail::Gains& gains : result.gains) tables.push_back(table_of(gains));
  std::uint8_t* color = result.cloud.colors.data();
  for (const std::uint8_t camera : result.cameras)
    for (const auto& channel : tables[camera]) {
      *color = channel[*color];
      ++color;
    }
}

}  // namespace

AllRoundCloud colorize_all_round(PointsView points, const std::vector<CameraView>& cameras,
                                 bool balance, Interpolation interpolation) {
  check(cameras);
  std::vector<Looker> lookers;
  for (const CameraView& camera : cameras)
    lookers.emplace_back(camera, static_cast<std::uint8_t>(lookers.size()), interpolation);
  detail::Exposures exposures(cameras.size());
  AllRoundCloud result;
  resize(result, points.size);
  std::size_t size = 0;
  for (std::size_t begin = 0; begin < points.size; begin += detail::point_block) {
    detail::check_interrupt();
    std::array<Seen, detail::point_block> seen{};
    for (const Looker& looker : lookers) looker.look(points, begin, seen.data(), exposures);
    size = collect(points, begin, seen.data(), size, result);
  }
  resize(result, size);
  result.gains.assign(cameras.size(), detail::Gains{1, 1, 1});
  if (balance) {
    result.gains = exposures.gains();
    apply_gains(result);
  }
  return result;
}

}  // namespace fusionslam
