// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// OUR-CVFH (Aldoma, Tombari, Rusu, Vincze, DAGM 2012).
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "../detail/parallel.hpp"
#include "fusionslam/descriptors.hpp"
#include "smooth_regions.hpp"

namespace fusionslam {
namespace {

using detail::OrientedPoints;
using detail::VfhCenter;
using Region = std::vector<std::uint32_t>;

constexpr std::size_t octants = 8;
constexpr std::size_t distance_bins = 13;
constexpr std::size_t angles_end = 3 * detail::vfh_angle_bins;

/// Where two axes' shares of mass on their lighter sides are this similar, neither is preferred.
constexpr double similar_axes = 0.8;

/// Above it, the sides of an axis cannot be told apart.
constexpr double balanced_axis = 0.925;

/// Width of the soft border between octants, leaves: PCL's 1 cm to its leaf of 5 mm.
constexpr double border_leaves = 2;

/// Frame of reference: columns are x, y = x cross z and z.
using Frame = Eigen::Matrix3d;

Eigen::Vector3d offset(const float* point, const VfhCenter& center) {
  return {static_cast<double>(point[0]) - static_cast<double>(center.point[0]),
          static_cast<double>(point[1]) - static_cast<double>(center.point[1]),
          static_cast<double>(point[2]) - static_cast<double>(center.point[2])};
}

/// The points of a region whose normal is within `max_angle` of that of the region.
Region core_of(const OrientedPoints& points, const Region& region, double max_angle) {
  const VfhCenter center = detail::region_center(points, region);
  const double least_cosine = std::cos(max_angle);
  Region core;
  for (const std::uint32_t i : region)
    if (static_cast<double>(detail::dot(center.normal.data(), points.normal(i))) > least_cosine)
      core.push_back(i);
  return core;
}

/// Eigenvectors of the region's scatter, points near its centroid counting more; longest first.
Frame principal_frame(const OrientedPoints& points, const Region& region, const VfhCenter& center) {
  double farthest = 0;
  for (const std::uint32_t i : region)
    farthest = std::max(farthest, offset(points.point(i), center).norm());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const std::uint32_t i : region) {
    const Eigen::Vector3d p = offset(points.point(i), center);
    scatter += (farthest - p.norm()) * p * p.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
  return solver.eigenvectors().rowwise().reverse();
}

/// Turns the axis towards where more of the cloud is; the share of the lighter side.
double turn_to_mass(const OrientedPoints& cloud, const VfhCenter& center, Eigen::Vector3d& axis) {
  double front = 0, back = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double along = axis.dot(offset(cloud.point(i), center));
    (along >= 0 ? front : back) += std::abs(along);
  }
  if (front < back) axis = -axis;
  const double larger = std::max(front, back);
  return larger > 0 ? std::min(front, back) / larger : 1;
}

Frame frame_of(const Eigen::Vector3d& x, const Eigen::Vector3d& z) {
  Frame frame;
  frame << x, x.cross(z), z;
  return frame;
}

/// The region's semi-global unique reference frames: one, or two or four if its axes are ambiguous.
std::vector<Frame> frames_of(const OrientedPoints& cloud, const OrientedPoints& points,
                             const Region& region, const VfhCenter& center) {
  const Frame principal = principal_frame(points, region, center);
  Eigen::Vector3d x = principal.col(0), y = principal.col(1), z = principal.col(2);
  const double share_x = turn_to_mass(cloud, center, x), share_y = turn_to_mass(cloud, center, y);
  const Eigen::Vector3d normal(center.normal[0], center.normal[1], center.normal[2]);
  if (normal.dot(z) < 0) z = -z;
  const double smaller = std::min(share_x, share_y), larger = std::max(share_x, share_y);
  if (!(smaller > similar_axes * larger)) return {frame_of(share_y < share_x ? y : x, z)};
  if (smaller > balanced_axis)
    return {frame_of(x, z), frame_of(-x, z), frame_of(y, z), frame_of(-y, z)};
  return {frame_of(x, z), frame_of(y, z)};
}

/// How much of a point lies on the positive side of a plane at this distance.
double positive_share(double distance, double border) {
  const double share = 0.5 * (1 - std::exp(-distance * distance / (2 * border * border)));
  return distance >= 0 ? 0.5 + share : 0.5 - share;
}

/// Histograms of the distances from the centre, one an octant: x, y, z negative first, z fastest.
void write_octants(const OrientedPoints& cloud, const VfhCenter& center, const Frame& frame,
                   double border, float* histograms) {
  double farthest = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i)
    farthest = std::max(farthest, offset(cloud.point(i), center).norm());
  std::array<double, octants * distance_bins> sums{};
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3d p = frame.transpose() * offset(cloud.point(i), center);
    // The last bin ends with the farthest point, which belongs to it.
    const double bin = std::ceil(distance_bins * p.norm() / farthest) - 1;
    const auto place = static_cast<std::size_t>(std::clamp(bin, 0.0, distance_bins - 1.0));
    const double x = positive_share(p.x(), border), y = positive_share(p.y(), border),
                 z = positive_share(p.z(), border);
    for (std::size_t k = 0; k < octants; ++k)
      sums[k * distance_bins + place] +=
          (k & 4 ? x : 1 - x) * (k & 2 ? y : 1 - y) * (k & 1 ? z : 1 - z);
  }
  const auto others = static_cast<double>(cloud.size() - 1);
  for (std::size_t i = 0; i < sums.size(); ++i)
    histograms[i] = static_cast<float>(100 * sums[i] / others);
}

/// The blocks of a region, one a frame.
std::vector<float> blocks_of(const OrientedPoints& cloud, const OrientedPoints& points,
                             const Region& region, double border) {
  const VfhCenter center = detail::region_center(points, region);
  const auto histogram = detail::vfh_histogram(cloud, center);
  std::vector<float> blocks;
  for (const Frame& frame : frames_of(cloud, points, region, center)) {
    // Octants take the place of distances and of the first viewpoint bins.
    auto block = histogram;
    write_octants(cloud, center, frame, border, block.data() + angles_end);
    blocks.insert(blocks.end(), block.begin(), block.end());
  }
  return blocks;
}

}  // namespace

std::vector<float> our_cvfh(PointsView points, const OurCvfhConfig& config, int threads) {
  validate(config);
  const OrientedPoints cloud =
      detail::oriented_points(points, {}, config.leaf, config.normal_radius, threads, "OUR-CVFH");
  const detail::SmoothRegions smooth =
      detail::smooth_regions(cloud,
                             {config.leaf, config.normal_radius, config.min_points,
                              config.max_curvature, config.max_angle},
                             threads, "OUR-CVFH");
  std::vector<Region> cores;
  for (const Region& region : smooth.regions) {
    cores.push_back(core_of(smooth.points, region, config.max_angle));
    if (cores.back().empty()) cores.pop_back();
  }
  if (cores.empty()) throw DataError("OUR-CVFH: no region has points with its mean normal");
  std::ranges::stable_sort(cores, std::greater{}, [](const Region& core) { return core.size(); });
  const auto most = static_cast<std::size_t>(config.regions);
  if (cores.size() > most) cores.resize(most);
  std::vector<std::vector<float>> blocks(cores.size());
  detail::parallel_for(cores.size(), threads, [&](std::size_t i) {
    blocks[i] = blocks_of(cloud, smooth.points, cores[i], border_leaves * config.leaf);
  });
  std::vector<float> descriptor;
  for (const auto& part : blocks) descriptor.insert(descriptor.end(), part.begin(), part.end());
  descriptor.resize(most * detail::vfh_size);
  return descriptor;
}

}  // namespace fusionslam
