// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "ordered_neighbors.hpp"

#include <algorithm>

namespace fusionslam::detail {
namespace {

/// Up to here counting smaller values, all against all in vectors, is faster than sorting.
constexpr std::size_t most_ranked = 192;

template <class Item>
void insertion_sort(Item* begin, Item* end) {
  for (Item* next = begin + 1; next < end; ++next) {
    const Item item = *next;
    Item* place = next;
    for (; place > begin && item < place[-1]; --place) *place = place[-1];
    *place = item;
  }
}

}  // namespace

void OrderedNeighbors::enter(std::size_t block) {
  cloud_.blocks_within(cloud_.block_box(block), squared_radius_, candidates_);
  const std::size_t room = (candidates_.size() + 1) * block_size;
  if (squared_.size() >= room) return;
  squared_.resize(room);
  places_.resize(room);
  ordered_.resize(room);
  ranks_.resize(std::min(room, most_ranked + block_size));
}

std::span<const std::uint32_t> OrderedNeighbors::of(std::size_t place) {
  const PointBlocks::Point& point = cloud_.points()[place];
  const float query[3] = {point.x, point.y, point.z};
  const std::size_t count =
      cloud_.kernels().points_within(cloud_.blocks(), candidates_.data(), candidates_.size(), query,
                                     squared_radius_, squared_.data(), places_.data());
  if (count <= most_ranked)
    order_by_rank(count);
  else
    order_by_bucket(count);
  return {ordered_.data(), count};
}

void OrderedNeighbors::order_by_rank(std::size_t count) {
  if (cloud_.kernels().ranks(squared_.data(), count, ranks_.data()) != count * (count - 1) / 2)
    rank_equals(count);
  for (std::size_t i = 0; i < count; ++i) ordered_[ranks_[i]] = places_[i];
}

void OrderedNeighbors::rank_equals(std::size_t count) {
  const std::uint32_t* indices = cloud_.indices();
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t j = 0; j < count; ++j)
      ranks_[i] += squared_[j] == squared_[i] && indices[places_[j]] < indices[places_[i]];
}

/// On a surface squared distances are spread evenly, so equal slices of them hold few points each.
void OrderedNeighbors::order_by_bucket(std::size_t count) {
  constexpr std::size_t few = 24;
  const std::size_t buckets = count / 4;
  const float largest = *std::max_element(squared_.data(), squared_.data() + count);
  const auto bucket_of = [&](float squared) {
    const float share = largest > 0 ? squared / largest : 0;
    return std::min(static_cast<std::size_t>(share * static_cast<float>(buckets)), buckets - 1);
  };
  ends_.assign(buckets + 1, 0);
  for (std::size_t i = 0; i < count; ++i) ++ends_[bucket_of(squared_[i]) + 1];
  for (std::size_t i = 1; i <= buckets; ++i) ends_[i] += ends_[i - 1];
  sorted_.resize(std::max(sorted_.size(), count));
  for (std::size_t i = 0; i < count; ++i)
    sorted_[ends_[bucket_of(squared_[i])]++] = {squared_[i], cloud_.indices()[places_[i]],
                                                places_[i]};
  std::size_t begin = 0;
  for (std::size_t i = 0; i < buckets; ++i) {
    Neighbor* first = sorted_.data() + begin;
    Neighbor* last = sorted_.data() + ends_[i];
    if (last - first <= static_cast<std::ptrdiff_t>(few))
      insertion_sort(first, last);
    else
      std::sort(first, last);
    begin = ends_[i];
  }
  for (std::size_t i = 0; i < count; ++i) ordered_[i] = sorted_[i].place;
}

}  // namespace fusionslam::detail
