// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Normals bit for bit as PCL's: its sums run in float, nearest neighbour first, and where the
// neighbours lie along a line its closed-form eigenvector amplifies their rounding without bound.
// So the search is our own, while order, sums and eigenvector are PCL's.
#include <pcl/features/normal_3d.h>

#include <cmath>
#include <limits>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "../detail/parallel.hpp"
#include "../detail/pcl.hpp"
#include "ordered_neighbors.hpp"
#include "surface_normals.hpp"

namespace fusionslam {
namespace {

using detail::block_size;
using detail::PointBlocks;

using Lanes = float __attribute__((vector_size(16)));

constexpr std::size_t blocks_an_item = 4;

struct Plane {
  float x, y, z;  ///< unit normal; NaN where there is none
  float curvature;
};

Lanes lanes(const PointBlocks::Point& point) { return Lanes{point.x, point.y, point.z, 0}; }

/// Lanes a, b, c and d. GCC before 12 has no __builtin_shufflevector, Clang no __builtin_shuffle.
template <int a, int b, int c, int d>
Lanes pick(Lanes values) {
#if __has_builtin(__builtin_shufflevector)
  return __builtin_shufflevector(values, values, a, b, c, d);
#else
  using Indices = int __attribute__((vector_size(16)));
  return __builtin_shuffle(values, Indices{a, b, c, d});
#endif
}

/// Covariance of the points, taken relative to the first of them.
Eigen::Matrix3f covariance(const PointBlocks& cloud, std::span<const std::uint32_t> places) {
  const Lanes origin = lanes(cloud.points()[places[0]]);
  Lanes xx_xy_xz_yy{}, yz_zz{}, sum{};
  for (const std::uint32_t place : places) {
    const Lanes offset = lanes(cloud.points()[place]) - origin;
    xx_xy_xz_yy += pick<0, 0, 0, 1>(offset) * pick<0, 1, 2, 1>(offset);
    yz_zz += pick<1, 2, 3, 3>(offset) * pick<2, 2, 3, 3>(offset);
    sum += offset;
  }
  const auto count = static_cast<float>(places.size());
  xx_xy_xz_yy /= count;
  yz_zz /= count;
  sum /= count;
  const float x = sum[0], y = sum[1], z = sum[2];
  const float xx = xx_xy_xz_yy[0] - x * x, xy = xx_xy_xz_yy[1] - x * y;
  const float xz = xx_xy_xz_yy[2] - x * z, yy = xx_xy_xz_yy[3] - y * y;
  const float yz = yz_zz[0] - y * z, zz = yz_zz[1] - z * z;
  Eigen::Matrix3f result;
  result << xx, xy, xz, xy, yy, yz, xz, yz, zz;
  return result;
}

Plane plane_at(const PointBlocks& cloud, std::size_t place,
               std::span<const std::uint32_t> neighbors) {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  Plane plane{nan, nan, nan, nan};
  if (neighbors.size() < 3) return plane;
  pcl::solvePlaneParameters(covariance(cloud, neighbors), plane.x, plane.y, plane.z,
                            plane.curvature);
  const PointBlocks::Point& point = cloud.points()[place];
  pcl::flipNormalTowardsViewpoint(pcl::PointXYZ(point.x, point.y, point.z), 0, 0, 0, plane.x,
                                  plane.y, plane.z);
  return plane;
}

/// In the order of the cloud.
std::vector<Plane> planes(const PointBlocks& cloud, float squared_radius, int threads) {
  std::vector<Plane> result(cloud.size());
  const std::size_t items = (cloud.block_count() + blocks_an_item - 1) / blocks_an_item;
  detail::parallel_for(items, threads, [&](std::size_t item) {
    detail::OrderedNeighbors neighbors(cloud, squared_radius);
    const std::size_t end = std::min((item + 1) * blocks_an_item, cloud.block_count());
    for (std::size_t block = item * blocks_an_item; block < end; ++block) {
      detail::check_interrupt();
      neighbors.enter(block);
      const std::size_t first = block * block_size;
      for (std::size_t place = first; place < std::min(first + block_size, cloud.size()); ++place)
        result[cloud.indices()[place]] = plane_at(cloud, place, neighbors.of(place));
    }
  });
  return result;
}

}  // namespace

void detail::check_normal_radius(double radius) {
  if (!(radius > 0))
    throw ConfigError("normal_radius is " + std::to_string(radius) + ", expected > 0");
}

Normals detail::surface_normals(const PointBlocks& cloud, double radius, int threads) {
  const std::vector<Plane> found = planes(cloud, static_cast<float>(radius * radius), threads);
  Normals result;
  result.normals.reserve(3 * found.size());
  result.curvatures.reserve(found.size());
  result.indices.reserve(found.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    const Plane& plane = found[i];
    if (!std::isfinite(plane.x)) continue;
    for (const float value : {plane.x, plane.y, plane.z}) result.normals.push_back(value);
    result.curvatures.push_back(plane.curvature);
    result.indices.push_back(static_cast<std::int64_t>(i));
  }
  return result;
}

Normals estimate_normals(PointsView points, double radius, int threads) {
  detail::check_normal_radius(radius);
  detail::check_points(points, 3, "normal estimation");
  return detail::surface_normals(PointBlocks(points, threads, simd_level()), radius, threads);
}

}  // namespace fusionslam
