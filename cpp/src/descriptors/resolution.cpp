// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>

#include "../detail/checks.hpp"
#include "../detail/parallel.hpp"
#include "surface_normals.hpp"

namespace fusionslam {
namespace {

using detail::block_size;
using detail::PointBlocks;

constexpr std::size_t blocks_an_item = 16;

/// Lowers `nearest` for the points of a block by those of another one, if any can come nearer.
void visit(const PointBlocks& cloud, std::size_t block, std::size_t other, float* nearest) {
  const auto& queries = cloud.blocks()[block];
  if (other != block && cloud.kernels().any_nearer(queries, cloud.block_box(other), nearest))
    cloud.kernels().nearest(queries, cloud.blocks()[other], nearest);
}

/// Squared distances of the points of a block to their nearest neighbours. The block itself and
/// its group come first: they leave little to search for elsewhere.
void nearest_of_block(const PointBlocks& cloud, std::size_t block, float* nearest,
                      std::vector<std::uint32_t>& found) {
  const std::size_t count = std::min(block_size, cloud.size() - block * block_size);
  std::fill_n(nearest, count, std::numeric_limits<float>::infinity());
  std::fill(nearest + count, nearest + block_size, 0.0F);  // unused places search for nothing
  cloud.kernels().nearest_in_block(cloud.blocks()[block], nearest);
  const std::size_t group = block / block_size * block_size;
  const std::size_t group_end = std::min(group + block_size, cloud.block_count());
  for (std::size_t other = group; other < group_end; ++other) visit(cloud, block, other, nearest);
  cloud.blocks_within(cloud.block_box(block), *std::max_element(nearest, nearest + block_size),
                      found);
  for (const std::uint32_t other : found)
    if (other < group || other >= group_end) visit(cloud, block, other, nearest);
}

}  // namespace

double detail::resolution(const PointBlocks& cloud, int threads) {
  std::vector<float> squared(cloud.size());
  const std::size_t items = (cloud.block_count() + blocks_an_item - 1) / blocks_an_item;
  parallel_for(items, threads, [&](std::size_t item) {
    std::vector<std::uint32_t> found;
    const std::size_t end = std::min((item + 1) * blocks_an_item, cloud.block_count());
    for (std::size_t block = item * blocks_an_item; block < end; ++block) {
      alignas(64) float nearest[block_size];
      nearest_of_block(cloud, block, nearest, found);
      const std::size_t first = block * block_size;
      for (std::size_t i = 0; i < block_size && first + i < cloud.size(); ++i)
        squared[cloud.indices()[first + i]] = nearest[i];
    }
  });
  double sum = 0;
  for (const float value : squared) sum += std::sqrt(static_cast<double>(value));
  return sum / static_cast<double>(cloud.size());
}

double cloud_resolution(PointsView points) {
  detail::check_points(points, 2, "the resolution");
  return detail::resolution(PointBlocks(points, 1, simd_level()), 1);
}

}  // namespace fusionslam
