// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "mirror_pairs.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace fusionslam::detail {
namespace {

/// Planes and sectors after mirroring axis 0, 1 or 2, and the side of it that they are on.
class Mirror {
 public:
  Mirror(int axis, const M2dpConfig& config) : axis_(axis), config_(config) {
    for (int sector = 0; sector < config.sectors; ++sector) {
      const double angle = 2 * std::numbers::pi * (sector + 0.5) / config.sectors;
      directions_.push_back({-std::cos(angle), -std::sin(angle)});
    }
  }

  int plane(int row) const {
    const int p = config_.azimuths;
    const int azimuth = row / config_.elevations;
    const int mirrored = axis_ == 0   ? (p + p / 2 - 1 - azimuth) % p
                         : axis_ == 1 ? p - 1 - azimuth
                                      : (azimuth + p / 2) % p;
    return mirrored * config_.elevations + row % config_.elevations;
  }

  int sector(int sector) const {
    const int t = config_.sectors;
    return axis_ == 0 ? (t + t / 2 - 1 - sector) % t : axis_ == 1 ? t - 1 - sector : sector;
  }

  /// Component along the axis of the direction to the middle of a sector.
  double side_of_bin(const KernelPlane& plane, int sector) const {
    const auto& [x, y] = directions_[static_cast<std::size_t>(sector)];
    return x * plane.x_axis[axis_] + y * plane.y_axis[axis_];
  }

  /// Component along the axis of a plane's normal.
  double side_of_plane(int row) const {
    const int azimuth = row / config_.elevations;
    const double angle = 2 * std::numbers::pi * (azimuth + 0.5) / config_.azimuths;
    return axis_ == 0 ? -std::cos(angle) : -std::sin(angle);
  }

 private:
  int axis_;
  const M2dpConfig& config_;
  std::vector<std::pair<double, double>> directions_;  ///< to the middle of each sector
};

/// Puts the larger of two values on the positive side.
void sort_pair(double side, double& here, double& mirrored) {
  if (std::fabs(side) < 1e-9)
    here = mirrored = (here + mirrored) / 2;  // in the mirror's own plane there is no side
  else if ((side > 0) != (here > mirrored))
    std::swap(here, mirrored);
}

void sort_shape_pairs(const Mirror& mirror, const M2dpConfig& config,
                      const std::vector<KernelPlane>& planes, Signature& signature) {
  const auto bin = [&](int row, int ring, int sector) -> double& {
    return signature
        .values[static_cast<std::size_t>(row * signature.columns + ring * config.sectors + sector)];
  };
  for (int row = 0; row < signature.rows; ++row)
    for (int sector = 0; sector < config.sectors; ++sector) {
      const std::pair mirrored(mirror.plane(row), mirror.sector(sector));
      if (mirrored < std::pair(row, sector)) continue;  // done from the other side
      const double side = mirror.side_of_bin(planes[static_cast<std::size_t>(row)], sector);
      for (int ring = 0; ring < config.rings; ++ring)
        sort_pair(side, bin(row, ring, sector), bin(mirrored.first, ring, mirrored.second));
    }
}

/// Colour histograms have no sectors: whole planes are each other's mirror images.
void sort_color_pairs(const Mirror& mirror, const M2dpConfig& config, Signature& signature) {
  for (int row = 0; row < signature.rows; ++row) {
    const int mirrored = mirror.plane(row);
    if (mirrored < row) continue;
    const double side = mirror.side_of_plane(row);
    for (int column = config.shape_columns(); column < signature.columns; ++column)
      sort_pair(side, signature.values[static_cast<std::size_t>(row * signature.columns + column)],
                signature.values[static_cast<std::size_t>(mirrored * signature.columns + column)]);
  }
}

}  // namespace

void sort_mirror_pairs(const M2dpConfig& config, const std::vector<KernelPlane>& planes,
                       Signature& signature) {
  for (int axis = 0; axis < 3; ++axis)
    sort_shape_pairs(Mirror(axis, config), config, planes, signature);
  // On planes, mirroring the third axis is the same as mirroring the first two.
  for (int axis = 0; axis < 2; ++axis) sort_color_pairs(Mirror(axis, config), config, signature);
}

}  // namespace fusionslam::detail
