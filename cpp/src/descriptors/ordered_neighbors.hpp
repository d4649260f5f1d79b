// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "../detail/point_blocks.hpp"

namespace fusionslam::detail {

/// Finds the neighbours of points one block at a time; one searcher a thread.
class OrderedNeighbors {
 public:
  OrderedNeighbors(const PointBlocks& cloud, float squared_radius)
      : cloud_(cloud), squared_radius_(squared_radius) {}

  /// Makes ready for the points of this block.
  void enter(std::size_t block);

  /// The places of all points nearer than the radius to the point at `place`, itself included,
  /// nearest first and equally distant ones in the order of the cloud: FLANN's sorted answer.
  /// Valid until the next call.
  std::span<const std::uint32_t> of(std::size_t place);

 private:
  struct Neighbor {
    float squared;
    std::uint32_t index, place;
    bool operator<(const Neighbor& other) const {
      return squared < other.squared || (squared == other.squared && index < other.index);
    }
  };

  void order_by_rank(std::size_t count);
  void order_by_bucket(std::size_t count);
  void rank_equals(std::size_t count);

  const PointBlocks& cloud_;
  float squared_radius_;
  std::vector<std::uint32_t> candidates_;
  std::vector<float> squared_;
  std::vector<std::uint32_t> places_, ranks_, ordered_, ends_;
  std::vector<Neighbor> sorted_;
};

}  // namespace fusionslam::detail
