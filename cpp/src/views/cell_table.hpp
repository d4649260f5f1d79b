// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
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

  /// Calls visit(number) for the cell and those of its 26 neighbours that were met.
  template <class Visit>
  void for_neighborhood(std::size_t number, Visit&& visit) const {
    const Cell center = cells_[number];
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y)
        for (int z = -1; z <= 1; ++z) {
          const Cell cell{center.x + x, center.y + y, center.z + z};
          if ((x != 0 && cell.x == center.x) || (y != 0 && cell.y == center.y) ||
              (z != 0 && cell.z == center.z))
            continue;
          const std::uint32_t found = slots_[slot_of(cell)];
          if (found != none) visit(found);
        }
  }

 private:
  double index(float coordinate) const {
    return std::floor(static_cast<double>(coordinate) / side_) + 0.0;  // no negative zero
  }

  /// Where the cell is, or would be.
  std::size_t slot_of(const Cell& cell) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t slot = hash(cell) & mask;
    while (slots_[slot] != none && cells_[slots_[slot]] != cell) slot = (slot + 1) & mask;
    return slot;
  }

  static std::uint64_t mix(std::uint64_t bits) {
    bits *= 0x9e3779b97f4a7c15ULL;
    bits ^= bits >> 29;
    bits *= 0xbf58476d1ce4e5b9ULL;
    return bits ^ (bits >> 32);
  }
  static std::size_t hash(const Cell& cell) {
    std::uint64_t bits = mix(std::bit_cast<std::uint64_t>(cell.x));
    bits = mix(bits + std::bit_cast<std::uint64_t>(cell.y));
    return mix(bits + std::bit_cast<std::uint64_t>(cell.z));
  }

  double side_;
  std::vector<std::uint32_t> slots_;
  std::vector<Cell> cells_;
};

}  // namespace fusionslam::detail
