// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace fusionslam::detail {

/// Numbers the cells of a cubic grid in the order in which they are first met. Memory is linear in
/// the number of points, whatever their extent.
class CellTable {
 public:
  /// Whole numbers held in doubles: where neighbours of a cell cannot be told from it, floats that
  /// differ lie in cells farther apart anyway.
  struct Cell {
    double x, y, z;
    bool operator==(const Cell&) const = default;
  };
  static constexpr std::uint32_t none = 0xffffffff;

  CellTable(double side, std::size_t most_cells)
      : side_(side), slots_(std::bit_ceil(2 * most_cells + 1), none) {}

  std::uint32_t insert(const float* point) {
    const Cell cell{index(point[0]), index(point[1]), index(point[2])};
    std::uint32_t& slot = slots_[slot_of(cell)];
    if (slot == none) {
      slot = static_cast<std::uint32_t>(cells_.size());
      cells_.push_back(cell);
    }
    return slot;
  }

  std::size_t size() const { return cells_.size(); }

  /// Looks up which cells touch, once all are there.
  void link() {
    std::vector<std::array<std::uint32_t, 2>> pairs;
    first_neighbors_.assign(size() + 1, 0);
    for (std::uint32_t number = 0; number < size(); ++number) {
      for_later_half(number, [&](std::uint32_t other) {
        pairs.push_back({number, other});
        ++first_neighbors_[number];
        ++first_neighbors_[other];
      });
      ++first_neighbors_[number];
    }
    for (std::size_t i = 1; i < first_neighbors_.size(); ++i)
      first_neighbors_[i] += first_neighbors_[i - 1];
    neighbors_.resize(first_neighbors_.back());
    for (std::uint32_t number = 0; number < size(); ++number)
      neighbors_[--first_neighbors_[number]] = number;
    for (const auto& [a, b] : pairs) {
      neighbors_[--first_neighbors_[a]] = b;
      neighbors_[--first_neighbors_[b]] = a;
    }
  }

  /// The cell itself and those of its 26 neighbours that were met.
  std::span<const std::uint32_t> neighborhood(std::size_t number) const {
    return {neighbors_.data() + first_neighbors_[number],
            neighbors_.data() + first_neighbors_[number + 1]};
  }

 private:
  double index(float coordinate) const {
    return std::floor(static_cast<double>(coordinate) / side_) + 0.0;  // no negative zero
  }

  /// Calls visit(other) for those of 13 neighbours that were met; the other 13 have this one.
  template <class Visit>
  void for_later_half(std::size_t number, Visit&& visit) const {
    const Cell center = cells_[number];
    for (int offset = 14; offset < 27; ++offset) {
      const int x = offset / 9 - 1, y = offset / 3 % 3 - 1, z = offset % 3 - 1;
      const Cell cell{center.x + x, center.y + y, center.z + z};
      if ((x != 0 && cell.x == center.x) || (y != 0 && cell.y == center.y) ||
          (z != 0 && cell.z == center.z))
        continue;
      const std::uint32_t found = slots_[slot_of(cell)];
      if (found != none) visit(found);
    }
  }

  /// Slot of the cell, or the one that it would get.
  std::size_t slot_of(const Cell& cell) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t slot = hash(cell) & mask;
    while (slots_[slot] != none && cells_[slots_[slot]] != cell) slot = (slot + 1) & mask;
    return slot;
  }

  static std::size_t hash(const Cell& cell) {
    std::uint64_t bits = std::bit_cast<std::uint64_t>(cell.x) * 0x9e3779b97f4a7c15ULL;
    bits = (bits ^ (bits >> 32)) + std::bit_cast<std::uint64_t>(cell.y) * 0xbf58476d1ce4e5b9ULL;
    bits = (bits ^ (bits >> 32)) + std::bit_cast<std::uint64_t>(cell.z) * 0x94d049bb133111ebULL;
    bits = (bits ^ (bits >> 29)) * 0xff51afd7ed558ccdULL;
    return bits ^ (bits >> 32);
  }

  double side_;
  std::vector<std::uint32_t> slots_;
  std::vector<Cell> cells_;
  std::vector<std::uint32_t> first_neighbors_;  // of each cell, in neighbors_
  std::vector<std::uint32_t> neighbors_;
};

}  // namespace fusionslam::detail
