// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "fusionslam/sensors.hpp"
#include "neighbor_kernel.hpp"

namespace fusionslam::detail {

/// A cloud in the order of a balanced k-d tree, cut into blocks of 16 points; 16 blocks are a
/// group, 16 groups a group of the next level, and so on. The shape depends on the number of points
/// only, so outliers, duplicates and any mixture of scales cost no more than other clouds do.
/// 34 bytes a point, 50 while it is built.
class PointBlocks {
 public:
  struct Point {
    float x, y, z;
    float unused = 0;
  };

  /// Throws DataError where squared distances between the points could overflow.
  PointBlocks(PointsView points, int threads, SimdLevel level);

  std::size_t size() const { return indices_.size(); }
  std::size_t block_count() const { return blocks_.size(); }
  const PointBlock* blocks() const { return blocks_.data(); }

  /// The points in this order; place i is in block i / block_size.
  const Point* points() const { return points_.data(); }

  /// Index of each point in the cloud.
  const std::uint32_t* indices() const { return indices_.data(); }

  Box block_box(std::size_t block) const;

  /// The blocks that may hold a point nearer than sqrt(squared_radius) to one in the box.
  void blocks_within(const Box& box, float squared_radius, std::vector<std::uint32_t>& found) const;

  const NeighborKernels& kernels() const { return kernels_; }

 private:
  void set_blocks();
  void set_boxes();

  NeighborKernels kernels_;
  std::vector<Point> points_;
  std::vector<std::uint32_t> indices_;
  std::vector<PointBlock> blocks_;
  std::vector<std::vector<BoxGroup>> levels_;  ///< the boxes of the blocks first, the root last
};

}  // namespace fusionslam::detail
