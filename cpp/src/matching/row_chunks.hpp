// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>
#include <utility>
#include <vector>

#include "fusionslam/matching.hpp"

namespace fusionslam::detail {

/// Memory that starts at a cache line, so that wide loads do not straddle two; large blocks ask
/// for huge pages, which make walking through them up to twice as fast.
void* allocate_lines(std::size_t bytes);
void free_lines(void* data, std::size_t bytes);

template <class T>
struct LineAllocator {
  using value_type = T;

  LineAllocator() = default;
  template <class Other>
  LineAllocator(const LineAllocator<Other>&) {}
  T* allocate(std::size_t count) { return static_cast<T*>(allocate_lines(count * sizeof(T))); }
  void deallocate(T* data, std::size_t count) { free_lines(data, count * sizeof(T)); }
  friend bool operator==(const LineAllocator&, const LineAllocator&) { return true; }
};

using AlignedFloats = std::vector<float, LineAllocator<float>>;

/// Rows of one length in chunks of one size: a growing table needs no second copy of itself, and
/// its rows stay where they are.
class RowChunks {
 public:
  explicit RowChunks(std::size_t dimension)
      : dimension_(dimension), chunk_rows_(std::max<std::size_t>(1, chunk_floats / dimension)) {}
  RowChunks(RowChunks&&) = default;
  RowChunks& operator=(RowChunks&&) = default;
  RowChunks(const RowChunks& other) : RowChunks(other.dimension_) {
    for (const auto& chunk : other.chunks_)
      std::ranges::copy(chunk, append_rows(chunk.size() / dimension_).data());
  }
  RowChunks& operator=(const RowChunks& other) { return *this = RowChunks(other); }
  ~RowChunks() = default;

  void append(std::span<const float> row) { std::ranges::copy(row, append_rows(1).data()); }

  /// New rows, zeros, for the caller to fill: up to `count`, as many as fit into one chunk.
  std::span<float> append_rows(std::size_t count) {
    const std::size_t full = chunk_rows_ * dimension_;
    if (chunks_.empty() || chunks_.back().size() == full) {
      AlignedFloats chunk;
      chunk.reserve(full);
      chunks_.push_back(std::move(chunk));
    }
    AlignedFloats& last = chunks_.back();
    const std::size_t begin = last.size();
    last.resize(begin + std::min(count * dimension_, full - begin));
    return std::span(last).subspan(begin);
  }

  /// Drops all but the first rows.
  void truncate(std::size_t rows) {
    chunks_.resize(std::min(chunks_.size(), (rows + chunk_rows_ - 1) / chunk_rows_));
    if (rows % chunk_rows_ != 0 && chunks_.size() == rows / chunk_rows_ + 1)
      chunks_.back().resize(rows % chunk_rows_ * dimension_);
  }

  std::span<const float> row(std::size_t i) const {
    return {chunks_[i / chunk_rows_].data() + i % chunk_rows_ * dimension_, dimension_};
  }

  std::size_t dimension() const { return dimension_; }
  std::size_t chunk_rows() const { return chunk_rows_; }
  std::size_t chunk_count() const { return chunks_.size(); }
  std::span<const float> chunk(std::size_t i) const { return chunks_[i]; }

 private:
  static constexpr std::size_t chunk_floats = std::size_t{1} << 21;  // 8 MiB
  std::size_t dimension_;
  std::size_t chunk_rows_;
  std::vector<AlignedFloats> chunks_;
};

}  // namespace fusionslam::detail

namespace fusionslam {

struct DescriptorIndex::Rows : detail::RowChunks {
  using RowChunks::RowChunks;
};

}  // namespace fusionslam
