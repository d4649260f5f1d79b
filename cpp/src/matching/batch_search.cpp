// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "batch_search.hpp"

#include <algorithm>
#include <bit>
#include <limits>

#include "../detail/interrupt.hpp"
#include "../detail/parallel.hpp"
#include "direct_search.hpp"

namespace fusionslam::detail {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Beyond it dot products may overflow, and then the bound says nothing.
constexpr double largest_norm = 1e36;

/// |p|^2 less its share of the tile's error.
double norm_term(double squared_norm, ErrorBound error) {
  return squared_norm < largest_norm ? squared_norm * (1 - error.relative) : -infinity;
}

}  // namespace

/// Some packed queries and their matches so far.
class BatchSearch::Block {
 public:
  Block(const BatchSearch& search, std::size_t first, std::size_t count)
      : search_(search),
        first_(first),
        count_(count),
        panels_(groups() * panel_size()),
        terms_(count),
        limits_(groups() * group(), std::numeric_limits<float>::infinity()),
        shortlists_(count, Shortlist(search.k_)),
        direct_(search.rows_.dimension) {
    AlignedFloats buffer(search.rows_.dimension);
    for (std::size_t q = 0; q < count; ++q)
      terms_[q] = norm_term(search.centred_norm(search.queries_[first + q], buffer), search.error_);
    for (std::size_t q = 0; q < count; q += group())
      pack_panel(search.queries_[first + q], std::min(group(), count - q), search.rows_.dimension,
                 search.center_.data(), group(), panels_.data() + q / group() * panel_size());
  }

  /// Rows from `row` on, packed.
  void compare(std::size_t row, const float* row_panel, const float* row_terms) {
    float bounds[largest_tile.queries * largest_tile.rows];
    std::uint32_t hits[largest_tile.queries];
    for (std::size_t q = 0; q < count_; q += group()) {
      const std::size_t last = std::min(q + group(), count_);
      if (search_.end_of(first_ + last - 1) <= row) continue;
      search_.kernels_.bounds(panels_.data() + q / group() * panel_size(), row_panel,
                              search_.rows_.dimension, row_terms, limits_.data() + q, bounds, hits);
      for (std::size_t i = q; i < last; ++i)
        add_hits(i, row, hits[i - q], bounds + (i - q) * search_.kernels_.tile.rows);
    }
  }

  std::vector<Match> matches(std::size_t q) { return shortlists_[q].matches(Filter{*this, q}); }

 private:
  struct Filter {
    const Block& block;
    std::size_t q;

    float limit(double squared) const {
      return round_up(squared + block.search_.error_.absolute - block.terms_[q]);
    }
    double exact(std::int64_t index, double worst) const {
      const Vectors& rows = block.search_.rows_;
      const float* query = block.search_.queries_[block.first_ + q];
      const float* row = rows[static_cast<std::size_t>(index)];
      const float limit = block.direct_.limit(worst);
      float square = 0;
      block.search_.kernels_.squares(query, row, 1, rows.dimension, limit, &square);
      return square > limit ? infinity : squared_distance(query, row, rows.dimension);
    }
  };

  std::size_t group() const { return search_.kernels_.tile.queries; }
  std::size_t groups() const { return (count_ + group() - 1) / group(); }
  std::size_t panel_size() const { return group() * search_.rows_.dimension; }

  void add_hits(std::size_t q, std::size_t row, std::uint32_t hits, const float* bounds) {
    const std::size_t end = search_.end_of(first_ + q);
    for (; hits != 0; hits &= hits - 1) {
      const auto i = static_cast<std::size_t>(std::countr_zero(hits));
      if (row + i >= end) break;
      shortlists_[q].add(static_cast<std::int64_t>(row + i), bounds[i], Filter{*this, q});
    }
    limits_[q] = shortlists_[q].limit();
  }

  const BatchSearch& search_;
  std::size_t first_;
  std::size_t count_;
  AlignedFloats panels_;
  std::vector<double> terms_;
  std::vector<float> limits_;
  std::vector<Shortlist> shortlists_;
  DirectFilter direct_;
};

BatchSearch::BatchSearch(Vectors queries, Vectors rows, std::optional<std::size_t> window,
                         std::size_t k, SimdLevel level)
    : queries_(queries),
      rows_(rows),
      window_(window),
      k_(k),
      level_(level),
      kernels_(distance_kernels(level)),
      error_(tile_error(rows.dimension)) {}

MatchTable BatchSearch::run(int threads) {
  MatchTable table{k_, std::vector<std::int64_t>(queries_.count * k_, -1),
                   std::vector<float>(queries_.count * k_, std::numeric_limits<float>::infinity())};
  if (queries_.count < 2 * kernels_.tile.queries) {  // not worth packing rows for
    parallel_for(queries_.count, threads, [&](std::size_t q) { search_one(q, table); });
    return table;
  }
  find_center();
  find_row_terms(threads);
  const std::size_t size = block_size(threads);
  const std::size_t blocks = (queries_.count + size - 1) / size;
  parallel_for(blocks, threads, [&](std::size_t i) {
    const std::size_t first = (blocks - 1 - i) * size;  // those with most candidates first
    search_block(first, std::min(size, queries_.count - first), table);
  });
  return table;
}

std::size_t BatchSearch::end_of(std::size_t query) const {
  if (!window_) return rows_.count;
  return query > *window_ ? query - *window_ : 0;
}

/// As many as fit the second cache, but enough blocks for all threads.
std::size_t BatchSearch::block_size(int threads) const {
  constexpr std::size_t cached_floats = std::size_t{1} << 18;
  const std::size_t group = kernels_.tile.queries;
  const std::size_t fair = queries_.count / (4 * thread_count(threads));
  const std::size_t wanted = std::min(fair, cached_floats / rows_.dimension);
  return std::max<std::size_t>(2, wanted / group) * group;
}

/// Distances do not change when all vectors are moved, but the error bounds of dot products shrink
/// when they are near the origin. About the mean is near enough.
void BatchSearch::find_center() {
  constexpr std::size_t samples = 1024;
  const std::size_t step = rows_.count / samples + 1;
  std::vector<double> sums(rows_.dimension);
  for (std::size_t row = 0; row < rows_.count; row += step)
    for (std::size_t c = 0; c < rows_.dimension; ++c) sums[c] += static_cast<double>(rows_[row][c]);
  const std::size_t count = (rows_.count + step - 1) / step;
  for (const double sum : sums)
    center_.push_back(
        static_cast<float>(sum / static_cast<double>(std::max<std::size_t>(count, 1))));
}

double BatchSearch::centred_norm(const float* vector, AlignedFloats& buffer) const {
  pack_panel(vector, 1, rows_.dimension, center_.data(), 1, buffer.data());
  return squared_norm(buffer.data(), rows_.dimension);
}

void BatchSearch::find_row_terms(int threads) {
  constexpr std::size_t rows_at_once = 256;
  row_terms_.resize(rows_.count + kernels_.tile.rows);  // the last tile may reach over the end
  parallel_for(rows_.count / rows_at_once + 1, threads, [&](std::size_t i) {
    AlignedFloats buffer(rows_.dimension);
    const std::size_t end = std::min((i + 1) * rows_at_once, rows_.count);
    for (std::size_t row = i * rows_at_once; row < end; ++row)
      row_terms_[row] = -round_up(-norm_term(centred_norm(rows_[row], buffer), error_));
  });
}

void BatchSearch::search_block(std::size_t first, std::size_t count, MatchTable& table) {
  const std::size_t width = kernels_.tile.rows;
  Block block(*this, first, count);
  AlignedFloats panel(width * rows_.dimension);
  const std::size_t end = end_of(first + count - 1);
  // Backwards, because the latest rows of a drive are the most alike: then few others pass.
  for (std::size_t tile = (end + width - 1) / width; tile-- > 0;) {
    const std::size_t row = tile * width;
    check_interrupt();
    pack_panel(rows_[row], std::min(width, rows_.count - row), rows_.dimension, center_.data(),
               width, panel.data());
    block.compare(row, panel.data(), row_terms_.data() + row);
  }
  for (std::size_t q = 0; q < count; ++q) store(first + q, block.matches(q), table);
}

void BatchSearch::search_one(std::size_t query, MatchTable& table) const {
  DirectSearch search(
      {queries_[query], rows_.dimension}, k_, [&](std::size_t i) { return rows_[i]; }, level_);
  search.scan(0, end_of(query), [](std::size_t) { return true; });
  store(query, search.matches(), table);
}

void BatchSearch::store(std::size_t query, const std::vector<Match>& matches,
                        MatchTable& table) const {
  for (std::size_t rank = 0; rank < matches.size(); ++rank) {
    table.indices[query * k_ + rank] = matches[rank].index;
    table.distances[query * k_ + rank] = matches[rank].distance;
  }
}

}  // namespace fusionslam::detail
