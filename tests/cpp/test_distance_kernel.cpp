// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The float filters on every level of this machine against exact distances, and the searches that
// rest on them against brute force, with data made to break them.
#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "fusionslam/interrupt.hpp"
#include "levels.hpp"
#include "matching/batch_search.hpp"
#include "matching/direct_search.hpp"

namespace fusionslam::detail {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();

struct Table {
  std::string name;
  std::size_t dimension;
  std::vector<float> values;

  std::size_t count() const { return values.size() / dimension; }
  Vectors view() const { return {values.data(), count(), dimension}; }
};

template <class Value>
Table table_of(std::string name, std::size_t count, std::size_t dimension, Value&& value) {
  Table table{std::move(name), dimension, {}};
  for (std::size_t i = 0; i < count * dimension; ++i)
    table.values.push_back(static_cast<float>(value(i / dimension, i % dimension)));
  return table;
}

/// Ordinary values, and all that a float filter may stumble over.
std::vector<Table> tables(std::size_t count, std::size_t dimension) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  const auto some = [&](std::size_t, std::size_t) { return normal(random); };
  const auto scaled = [&](double scale) {
    return [&, scale](std::size_t, std::size_t) { return scale * normal(random); };
  };
  std::vector<Table> result;
  result.push_back(table_of("normal", count, dimension, some));
  result.push_back(table_of("few values", count, dimension,
                            [&](auto, auto) { return static_cast<double>(random() % 2); }));
  result.push_back(table_of("all the same", count, dimension, [](auto, auto) { return 0.3; }));
  result.push_back(table_of("near ties", count, dimension, [&](auto, std::size_t c) {
    return (c % 2 == 0 ? 1.0 : -2.0) * (1 + 1e-7 * static_cast<double>(random() % 3));
  }));
  result.push_back(table_of("far from the origin", count, dimension, [&](auto, std::size_t c) {
    return 1e4 + 100.0 * static_cast<double>(c) + 1e-2 * normal(random);
  }));
  result.push_back(table_of("two far clusters", count, dimension, [&](std::size_t r, auto) {
    return (r % 2 == 0 ? 3e4 : -3e4) + 1e-1 * normal(random);
  }));
  result.push_back(table_of("denormals", count, dimension, scaled(1e-42)));
  result.push_back(table_of("squares that underflow", count, dimension, scaled(1e-22)));
  result.push_back(table_of("squares that overflow", count, dimension, scaled(1e25)));
  result.push_back(table_of("all scales", count, dimension, [&](auto, auto) {
    return normal(random) * std::pow(10.0, static_cast<double>(random() % 80) - 44);
  }));
  return result;
}

/// Squared distances to the rows below `end`, with their numbers, nearest first: the definition.
std::vector<std::pair<double, std::int64_t>> brute_force(Vectors queries, std::size_t query,
                                                         Vectors rows, std::size_t end) {
  std::vector<std::pair<double, std::int64_t>> found;
  for (std::size_t row = 0; row < end; ++row)
    found.push_back({squared_distance(queries[query], rows[row], rows.dimension),
                     static_cast<std::int64_t>(row)});
  std::sort(found.begin(), found.end());
  return found;
}

MatchTable expected_table(Vectors queries, Vectors rows, std::optional<std::size_t> window,
                          std::size_t k) {
  MatchTable table{k, {}, {}};
  for (std::size_t q = 0; q < queries.count; ++q) {
    const std::size_t end = !window ? rows.count : q > *window ? q - *window : 0;
    auto found = brute_force(queries, q, rows, end);
    found.resize(k, {std::numeric_limits<double>::infinity(), -1});
    for (const auto& [squared, index] : found) {
      table.indices.push_back(index);
      table.distances.push_back(static_cast<float>(std::sqrt(squared)));
    }
  }
  return table;
}

/// The first k columns.
MatchTable cut(const MatchTable& table, std::size_t k) {
  MatchTable result{k, {}, {}};
  for (std::size_t i = 0; i < table.indices.size(); ++i) {
    if (i % table.k >= k) continue;
    result.indices.push_back(table.indices[i]);
    result.distances.push_back(table.distances[i]);
  }
  return result;
}

bool operator==(const MatchTable& a, const MatchTable& b) {
  return a.k == b.k && a.indices == b.indices && a.distances == b.distances;
}

TEST_CASE("the direct filter's squares are within their error bound on every level") {
  for (const std::size_t dimension : {1U, 7U, 15U, 16U, 31U, 33U, 64U, 192U, 575U, 576U}) {
    const ErrorBound error = direct_error(dimension);
    for (const Table& table : tables(23, dimension)) {
      INFO(table.name, ", dimension ", dimension);
      std::vector<float> moved(table.values.size() + 1);  // rows at no multiple of a vector
      std::copy(table.values.begin(), table.values.end(), moved.begin() + 1);
      const Vectors rows{moved.data() + 1, table.count(), dimension};
      for (const SimdLevel level : simd_levels()) {
        std::vector<float> squares(rows.count);
        distance_kernels(level).squares(rows[3], rows.data, rows.count, dimension, infinity,
                                        squares.data());
        for (std::size_t row = 0; row < rows.count; ++row) {
          const double exact = squared_distance(rows[3], rows[row], dimension);
          const double allowed = error.relative * exact + error.absolute;
          const auto square = static_cast<double>(squares[row]);
          if (std::isinf(square))
            CHECK(exact + allowed > static_cast<double>(std::numeric_limits<float>::max()));
          else
            CHECK(std::fabs(square - exact) <= allowed);
        }
      }
    }
  }
}

TEST_CASE("rows left early are above the limit, and the others are not changed by it") {
  for (const std::size_t dimension : {7U, 192U, 576U, 1000U}) {
    const Table table = tables(40, dimension)[0];
    const Vectors rows = table.view();
    for (const SimdLevel level : simd_levels()) {
      const auto kernels = distance_kernels(level);
      std::vector<float> all(rows.count), some(rows.count);
      kernels.squares(rows[0], rows.data, rows.count, dimension, infinity, all.data());
      for (const float limit : {0.0F, all[5], 1.5F * static_cast<float>(dimension), infinity}) {
        kernels.squares(rows[0], rows.data, rows.count, dimension, limit, some.data());
        for (std::size_t row = 0; row < rows.count; ++row) {
          CHECK((some[row] > limit) == (all[row] > limit));
          if (all[row] <= limit) CHECK(some[row] == all[row]);
        }
      }
    }
  }
}

TEST_CASE("the tile filter's bounds are within their error bound on every level") {
  for (const std::size_t dimension : {1U, 7U, 192U, 255U, 256U, 257U, 576U, 1030U}) {
    const ErrorBound error = tile_error(dimension);
    for (const Table& table : tables(32, dimension)) {
      INFO(table.name, ", dimension ", dimension);
      const Vectors rows = table.view();
      const std::vector<float> center(rows[9], rows[9] + dimension);
      for (const SimdLevel level : simd_levels()) {
        const auto kernels = distance_kernels(level);
        const auto [queries, width] = kernels.tile;
        std::vector<float> query_panel(queries * dimension), row_panel(width * dimension);
        std::vector<float> bounds(queries * width), row_terms(width);
        pack_panel(rows.data, queries, dimension, center.data(), queries, query_panel.data());
        pack_panel(rows.data, width, dimension, center.data(), width, row_panel.data());
        const auto norm = [&](std::size_t row) {
          std::vector<float> centred(dimension);
          pack_panel(rows[row], 1, dimension, center.data(), 1, centred.data());
          return squared_norm(centred.data(), dimension);
        };
        for (std::size_t row = 0; row < width; ++row) row_terms[row] = round_up(norm(row));
        const std::vector<float> limits(queries, row_terms[2]);
        std::vector<std::uint32_t> hits(queries);
        kernels.bounds(query_panel.data(), row_panel.data(), dimension, row_terms.data(),
                       limits.data(), bounds.data(), hits.data());
        for (std::size_t q = 0; q < queries; ++q)
          for (std::size_t row = 0; row < width; ++row) {
            const float bound = bounds[q * width + row];
            CHECK((hits[q] >> row & 1U) == !(bound > limits[q]));
            const double norms = norm(q) + norm(row);
            if (norms > 1e36) continue;  // where the search does not rely on it
            const double exact = squared_distance(rows[q], rows[row], dimension);
            CHECK(std::fabs(static_cast<double>(bound) + norm(q) - exact) <=
                  error.relative * norms + error.absolute);
          }
      }
    }
  }
}

TEST_CASE("a panel is zero where there are no rows") {
  const std::vector<float> rows{1, 2, 3, 4, 5, 6}, center{1, 1, 1};
  std::vector<float> panel(12, -1);
  pack_panel(rows.data(), 2, 3, center.data(), 4, panel.data());
  CHECK(panel == std::vector<float>{0, 3, 0, 0, 1, 4, 0, 0, 2, 5, 0, 0});
}

TEST_CASE("a batch finds what brute force finds, on every level and for any number of threads") {
  for (const std::size_t dimension : {1U, 7U, 192U, 575U, 576U}) {
    for (const Table& table : tables(dimension < 100 ? 333 : 120, dimension)) {
      INFO(table.name, ", dimension ", dimension);
      const Vectors rows = table.view();
      for (const auto window : {std::optional<std::size_t>{}, std::optional<std::size_t>{40}}) {
        const auto all = expected_table(rows, rows, window, 400);
        for (const std::size_t k : {1U, 10U, 400U}) {
          const auto expected = cut(all, k);
          for (const SimdLevel level : simd_levels())
            CHECK(BatchSearch(rows, rows, window, k, level).run(1) == expected);
          CHECK(BatchSearch(rows, rows, window, k, simd_levels().back()).run(3) == expected);
        }
      }
    }
  }
}

TEST_CASE("few or many queries, one row or none: the batch is brute force") {
  const Table table = tables(100, 24)[0];
  for (const std::size_t queries : {0U, 1U, 5U, 27U, 28U, 29U, 100U}) {
    for (const std::size_t count : {0U, 1U, 31U, 33U, 100U}) {
      const Vectors wanted{table.values.data(), queries, 24};
      const Vectors rows{table.values.data(), count, 24};
      for (const SimdLevel level : simd_levels())
        CHECK(BatchSearch(wanted, rows, std::nullopt, 3, level).run(2) ==
              expected_table(wanted, rows, std::nullopt, 3));
    }
  }
}

TEST_CASE("one query finds what brute force finds on every level") {
  for (const std::size_t dimension : {1U, 7U, 192U, 575U, 576U}) {
    for (const Table& table : tables(700, dimension)) {
      INFO(table.name, ", dimension ", dimension);
      const Vectors rows = table.view();
      for (const std::size_t query : {0U, 350U}) {
        const auto all = brute_force(rows, query, rows, rows.count);
        for (const std::size_t k : {1U, 10U, 1000U}) {
          for (const SimdLevel level : simd_levels()) {
            DirectSearch search(
                {rows[query], dimension}, k, [&](std::size_t i) { return rows[i]; }, level);
            search.scan(0, rows.count, [](std::size_t) { return true; });
            const auto matches = search.matches();
            REQUIRE(matches.size() == std::min(k, rows.count));
            for (std::size_t rank = 0; rank < matches.size(); ++rank) {
              CHECK(matches[rank].index == all[rank].second);
              CHECK(matches[rank].distance == static_cast<float>(std::sqrt(all[rank].first)));
            }
          }
        }
      }
    }
  }
}

TEST_CASE("only rows that may be among the nearest get their exact distance") {
  const Table table = tables(4000, 64)[0];
  struct Counting {
    Vectors rows;
    mutable int exact_distances = 0;

    float limit(double squared) const { return DirectFilter(64).limit(squared); }
    double exact(std::int64_t index, double) const {
      ++exact_distances;
      return squared_distance(rows[0], rows[static_cast<std::size_t>(index)], 64);
    }
  };
  const Counting filter{table.view()};
  Shortlist shortlist(5);
  std::vector<float> squares(4000);
  distance_kernels(simd_levels().back())
      .squares(filter.rows[0], filter.rows.data, 4000, 64, infinity, squares.data());
  for (std::size_t i = 0; i < squares.size(); ++i)
    if (!(squares[i] > shortlist.limit()))
      shortlist.add(static_cast<std::int64_t>(i), squares[i], filter);
  CHECK(shortlist.matches(filter).size() == 5);
  CHECK(filter.exact_distances < 60);
}

/// An interrupt is asked for every 20 ms at most, which a short call may miss.
template <class Call>
bool is_interrupted_in_time(Call&& call) {
  const InterruptScope scope([] { return true; });
  for (int attempt = 0; attempt < 1000; ++attempt) {
    try {
      call();
    } catch (const Interrupted&) {
      return true;
    }
  }
  return false;
}

TEST_CASE("batches and queries end when an interrupt is asked for") {
  const Table table = tables(2000, 16)[0];
  for (const int threads : {1, 2}) {
    CHECK(is_interrupted_in_time([&] { nearest(table.values, table.values, 16, 1, threads); }));
    CHECK(is_interrupted_in_time([&] { nearest_causal(table.values, 16, 0, 1, threads); }));
  }
  DescriptorIndex index(16);
  for (std::size_t i = 0; i < table.count(); ++i) index.add({table.view()[i], 16});
  CHECK(is_interrupted_in_time([&] {
    for (int i = 0; i < 100; ++i) index.query({table.view()[0], 16});
  }));
}

}  // namespace
}  // namespace fusionslam::detail
