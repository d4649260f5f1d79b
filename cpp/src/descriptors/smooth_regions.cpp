// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The stable regions of CVFH (Aldoma et al., ICCV Workshops 2011). Whether two neighbours are
// joined depends on these two alone, so growing a region from seeds, as PCL does, finds the
// connected components of a graph, whatever the seeds.
#include "smooth_regions.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

#include "../detail/interrupt.hpp"
#include "../detail/parallel.hpp"
#include "fusionslam/errors.hpp"
#include "fusionslam/simd.hpp"
#include "ordered_neighbors.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t blocks_an_item = 4;

using Pair = std::pair<std::uint32_t, std::uint32_t>;

/// Neighbours with similar normals, each pair once.
std::vector<std::vector<Pair>> joined_pairs(const OrientedPoints& points, const RegionRule& rule,
                                            int threads) {
  const PointBlocks cloud(points.points_view(), threads, simd_level());
  const auto squared = static_cast<float>(rule.tolerance() * rule.tolerance());
  const auto least_cosine = static_cast<float>(std::cos(rule.max_angle));
  const std::size_t items = (cloud.block_count() + blocks_an_item - 1) / blocks_an_item;
  std::vector<std::vector<Pair>> pairs(items);
  parallel_for(items, threads, [&](std::size_t item) {
    OrderedNeighbors neighbors(cloud, squared);
    const std::size_t end = std::min((item + 1) * blocks_an_item, cloud.block_count());
    for (std::size_t block = item * blocks_an_item; block < end; ++block) {
      check_interrupt();
      neighbors.enter(block);
      const std::size_t first = block * block_size;
      for (std::size_t place = first; place < std::min(first + block_size, cloud.size()); ++place) {
        const std::uint32_t a = cloud.indices()[place];
        for (const std::uint32_t other : neighbors.of(place)) {
          const std::uint32_t b = cloud.indices()[other];
          if (a < b && dot(points.normal(a), points.normal(b)) > least_cosine)
            pairs[item].emplace_back(a, b);
        }
      }
    }
  });
  return pairs;
}

/// Sets of places, each known by its lowest one.
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t size) : parents_(size) {
    std::iota(parents_.begin(), parents_.end(), 0U);
  }
  std::uint32_t find(std::uint32_t place) {
    while (parents_[place] != place) place = parents_[place] = parents_[parents_[place]];
    return place;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = find(a), b = find(b);
    parents_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parents_;
};

/// The sets with at least `least` places, the largest first and equal ones in the order of their
/// first places.
std::vector<std::vector<std::uint32_t>> large_sets(DisjointSets& sets, std::size_t size,
                                                   std::size_t least) {
  std::vector<std::vector<std::uint32_t>> members(size);
  for (std::uint32_t i = 0; i < size; ++i) members[sets.find(i)].push_back(i);
  std::erase_if(members, [&](const auto& set) { return set.size() < least; });
  std::ranges::stable_sort(members, std::greater{}, [](const auto& set) { return set.size(); });
  return members;
}

}  // namespace

SmoothRegions smooth_regions(const OrientedPoints& cloud, const RegionRule& rule, int threads,
                             const char* name) {
  std::vector<std::uint32_t> smooth;
  for (std::uint32_t i = 0; i < cloud.size(); ++i)
    if (!(static_cast<double>(cloud.curvatures[i]) > rule.max_curvature)) smooth.push_back(i);
  SmoothRegions result{with_new_normals(cloud, smooth, rule.radius(), threads), {}};
  DisjointSets sets(result.points.size());
  if (result.points.size() > 0)
    for (const auto& part : joined_pairs(result.points, rule, threads))
      for (const auto& [a, b] : part) sets.join(a, b);
  result.regions =
      large_sets(sets, result.points.size(), static_cast<std::size_t>(rule.min_points));
  if (result.regions.empty())
    throw DataError(std::string(name) + ": the cloud has no smooth region of " +
                    std::to_string(rule.min_points) + " points that are less than " +
                    std::to_string(rule.tolerance()) + " m apart; of " +
                    std::to_string(cloud.size()) + " points with a normal, " +
                    std::to_string(smooth.size()) + " have a curvature of at most " +
                    std::to_string(rule.max_curvature));
  return result;
}

VfhCenter region_center(const OrientedPoints& points, const std::vector<std::uint32_t>& region) {
  std::array<double, 3> point{}, normal{};
  for (const std::uint32_t i : region)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      point[axis] += points.point(i)[axis];
      normal[axis] += points.normal(i)[axis];
    }
  const double length = std::hypot(normal[0], normal[1], normal[2]);
  VfhCenter center;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    center.point[axis] = static_cast<float>(point[axis] / static_cast<double>(region.size()));
    center.normal[axis] = static_cast<float>(normal[axis] / length);
  }
  return center;
}

}  // namespace fusionslam::detail
