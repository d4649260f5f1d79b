// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// 3D Gestalt descriptors (Bosse, Zlot, ICRA 2013).
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <utility>

#include "../detail/checks.hpp"
#include "../detail/parallel.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/fusion.hpp"

namespace fusionslam {
namespace {

constexpr std::size_t rings = 4;
constexpr std::size_t sectors = 8;
constexpr std::size_t bins = rings * sectors;
constexpr std::size_t block_size = 2 * bins + 2;

/// A point relative to a keypoint.
struct Offset {
  double x, y, z;
};

/// Points sorted by columns as wide as the cylinder's radius.
class Columns {
 public:
  Columns(PointsView points, double width) : points_(points), width_(width) {
    for (std::size_t i = 0; i < points.size; ++i)
      entries_.emplace_back(Column{cell(points[i][0]), cell(points[i][1])}, i);
    std::ranges::sort(entries_);
  }

  /// The points nearer to the keypoint than the width of a column, seen from above.
  std::vector<Offset> around(const float* keypoint) const {
    std::vector<Offset> found;
    const std::int64_t column_x = cell(keypoint[0]), column_y = cell(keypoint[1]);
    for (std::int64_t x = column_x - 1; x <= column_x + 1; ++x) {
      // Columns of one x follow each other.
      auto entry = std::ranges::lower_bound(entries_, Entry{{x, column_y - 1}, 0});
      for (; entry != entries_.end() && entry->first <= Column{x, column_y + 1}; ++entry) {
        const float* point = points_[entry->second];
        const Offset offset{static_cast<double>(point[0]) - static_cast<double>(keypoint[0]),
                            static_cast<double>(point[1]) - static_cast<double>(keypoint[1]),
                            static_cast<double>(point[2]) - static_cast<double>(keypoint[2])};
        if (offset.x * offset.x + offset.y * offset.y < width_ * width_) found.push_back(offset);
      }
    }
    return found;
  }

 private:
  using Column = std::pair<std::int64_t, std::int64_t>;
  using Entry = std::pair<Column, std::size_t>;

  /// Coordinates too large for numbers of cells share the last ones.
  std::int64_t cell(float coordinate) const {
    constexpr double last = 1e15;
    const double number = std::floor(static_cast<double>(coordinate) / width_);
    return static_cast<std::int64_t>(std::clamp(number, -last, last));
  }

  PointsView points_;
  double width_;
  std::vector<Entry> entries_;
};

/// Azimuth of the longer horizontal principal axis, on the side where the third moment is positive.
double main_azimuth(std::span<const Offset> offsets) {
  double mean_x = 0, mean_y = 0;
  for (const Offset& o : offsets) mean_x += o.x, mean_y += o.y;
  mean_x /= static_cast<double>(offsets.size());
  mean_y /= static_cast<double>(offsets.size());
  double xx = 0, xy = 0, yy = 0;
  for (const Offset& o : offsets) {
    const double x = o.x - mean_x, y = o.y - mean_y;
    xx += x * x, xy += x * y, yy += y * y;
  }
  const double azimuth = 0.5 * std::atan2(2 * xy, xx - yy);
  const double c = std::cos(azimuth), s = std::sin(azimuth);
  double third_moment = 0;
  for (const Offset& o : offsets) {
    const double along = c * (o.x - mean_x) + s * (o.y - mean_y);
    third_moment += along * along * along;
  }
  return third_moment < 0 ? azimuth + std::numbers::pi : azimuth;
}

std::size_t bin_of(const Offset& offset, double azimuth, double radius) {
  if (offset.x == 0 && offset.y == 0) return 0;  // the keypoint itself has no azimuth
  const double ring = std::hypot(offset.x, offset.y) / radius * static_cast<double>(rings);
  const double turn = (std::atan2(offset.y, offset.x) - azimuth) / (2 * std::numbers::pi);
  const double sector = (turn - std::floor(turn)) * static_cast<double>(sectors);
  return std::min(static_cast<std::size_t>(ring), rings - 1) * sectors +
         std::min(static_cast<std::size_t>(sector), sectors - 1);
}

/// Mean and variance of the heights in each bin.
void write_block(std::span<const Offset> offsets, double radius, float* block) {
  const double azimuth = main_azimuth(offsets);
  std::array<double, bins> counts{}, sums{}, squares{};
  std::vector<std::size_t> places;
  places.reserve(offsets.size());
  for (const Offset& offset : offsets) {
    places.push_back(bin_of(offset, azimuth, radius));
    ++counts[places.back()];
    sums[places.back()] += offset.z;
  }
  for (std::size_t i = 0; i < bins; ++i) sums[i] /= std::max(counts[i], 1.0);
  for (std::size_t i = 0; i < offsets.size(); ++i)
    squares[places[i]] += std::pow(offsets[i].z - sums[places[i]], 2);
  for (std::size_t i = 0; i < bins; ++i) {
    block[i] = static_cast<float>(sums[i]);
    block[bins + i] = static_cast<float>(squares[i] / std::max(counts[i], 1.0));
  }
}

/// The indices 0 to size - 1, shuffled with a fixed seed, the same everywhere (std::shuffle is
/// not).
std::vector<std::size_t> shuffled(std::size_t size) {
  std::vector<std::size_t> order(size);
  for (std::size_t i = 0; i < size; ++i) order[i] = i;
  std::mt19937 random;  // the default seed
  for (std::size_t i = 0; i + 1 < size; ++i) {
    const std::uint64_t rest = size - i;
    std::swap(order[i], order[i + static_cast<std::size_t>(random() * rest >> 32)]);
  }
  return order;
}

/// The first points, in random order, that have enough neighbours in their cylinder, and these.
std::vector<std::pair<std::size_t, std::vector<Offset>>> keypoints(PointsView points,
                                                                   const GestaltConfig& config) {
  const Columns columns(points, config.radius);
  std::vector<std::pair<std::size_t, std::vector<Offset>>> found;
  for (const std::size_t i : shuffled(points.size)) {
    if (found.size() == static_cast<std::size_t>(config.keypoints)) break;
    detail::check_interrupt();
    auto offsets = columns.around(points[i]);
    if (offsets.size() >= static_cast<std::size_t>(config.min_points))
      found.emplace_back(i, std::move(offsets));
  }
  return found;
}

}  // namespace

std::vector<float> gestalt(PointsView points, const GestaltConfig& config, int threads) {
  validate(config);
  detail::check_points(points, 3, "3D Gestalt");
  const ColoredCloud sparse = voxel_downsample(points, {}, config.leaf);
  const PointsView cloud = sparse.points_view();
  const auto chosen = keypoints(cloud, config);
  if (chosen.empty())
    throw DataError("3D Gestalt: of " + detail::count_text(cloud.size, "point") + ", " +
                    std::to_string(config.leaf) + " m apart, none has " +
                    std::to_string(config.min_points) + " within " + std::to_string(config.radius) +
                    " m, itself included");
  std::vector<float> descriptor(static_cast<std::size_t>(config.keypoints) * block_size);
  detail::parallel_for(chosen.size(), threads, [&](std::size_t i) {
    float* block = descriptor.data() + i * block_size;
    write_block(chosen[i].second, config.radius, block);
    block[2 * bins] = cloud[chosen[i].first][0];
    block[2 * bins + 1] = cloud[chosen[i].first][1];
  });
  return descriptor;
}

}  // namespace fusionslam
