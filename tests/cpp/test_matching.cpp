// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>

#include "fusionslam/errors.hpp"
#include "fusionslam/matching.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

namespace fs = std::filesystem;
using testing::check_refused;

using Rows = std::vector<std::vector<float>>;

/// Few different values, so that equal distances are common.
Rows coarse_rows(std::size_t count, std::size_t dimension, unsigned seed) {
  std::mt19937 random(seed);
  Rows rows(count, std::vector<float>(dimension));
  for (auto& row : rows)
    for (auto& value : row) value = static_cast<float>(random() % 3);
  return rows;
}

std::vector<float> flat(const Rows& rows) {
  std::vector<float> values;
  for (const auto& row : rows) values.insert(values.end(), row.begin(), row.end());
  return values;
}

/// Candidates sorted by distance, then index: the definition.
template <class IsCandidate>
std::vector<Match> brute_force(const Rows& rows, const std::vector<float>& query, std::size_t k,
                               IsCandidate&& is_candidate) {
  std::vector<Match> found;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!is_candidate(i)) continue;
    double sum = 0;
    for (std::size_t c = 0; c < query.size(); ++c)
      sum += std::pow(static_cast<double>(rows[i][c]) - static_cast<double>(query[c]), 2);
    found.push_back({static_cast<std::int64_t>(i), static_cast<float>(std::sqrt(sum))});
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Match& a, const Match& b) { return a.distance < b.distance; });
  if (found.size() > k) found.erase(found.begin() + static_cast<std::ptrdiff_t>(k), found.end());
  return found;
}

bool same(const std::vector<Match>& a, const std::vector<Match>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const Match& x, const Match& y) {
    return x.index == y.index && x.distance == y.distance;
  });
}

TEST_CASE("an index finds the neighbours of a brute-force search with a window in frames") {
  for (const std::size_t dimension : {1U, 3U, 4U, 9U}) {
    for (const std::size_t window : {0U, 1U, 10U, 500U}) {
      const Rows rows = coarse_rows(60, dimension, 1);
      DescriptorIndex index(dimension, {window, 0});
      Rows added;
      for (const auto& row : rows) {
        for (const std::size_t k : {1U, 5U, 100U}) {
          const auto expected =
              brute_force(added, row, k, [&](std::size_t i) { return added.size() - i > window; });
          CHECK(same(index.query(row, k), expected));
        }
        CHECK(index.add(row) == static_cast<std::int64_t>(added.size()));
        added.push_back(row);
      }
    }
  }
}

TEST_CASE("a window in seconds leaves out what is not older") {
  const Rows rows = coarse_rows(80, 4, 2);
  DescriptorIndex index(4, {3, 1'000'000'000});
  std::mt19937 random(3);
  Rows added;
  std::vector<std::int64_t> stamps;
  std::int64_t now = 1'600'000'000'000'000'000;
  for (const auto& row : rows) {
    now += static_cast<std::int64_t>(random() % 3) * 100'000'000;
    const auto expected = brute_force(added, row, 2, [&](std::size_t i) {
      return added.size() - i > 3 && now - stamps[i] > 1'000'000'000;
    });
    CHECK(same(index.query(row, 2, now), expected));
    index.add(row, now);
    added.push_back(row);
    stamps.push_back(now);
  }
  check_refused<ConfigError>([&] { index.query(rows[0]); }, "stamp_ns");
}

TEST_CASE("stamps at the ends of their range do not overflow") {
  constexpr auto first = std::numeric_limits<std::int64_t>::min();
  constexpr auto last = std::numeric_limits<std::int64_t>::max();
  DescriptorIndex index(1, {0, 5});
  index.add(std::vector<float>{1}, first);
  index.add(std::vector<float>{1}, last);
  CHECK(index.query(std::vector<float>{1}, 9, last).size() == 1);
  CHECK(index.query(std::vector<float>{1}, 9, first).empty());
}

TEST_CASE("equal distances go to the lowest index") {
  DescriptorIndex index(2);
  for (int i = 0; i < 5; ++i) index.add(std::vector<float>{1, 1});
  const auto matches = index.query(std::vector<float>{0, 0}, 3);
  REQUIRE(matches.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) CHECK(matches[i].index == static_cast<std::int64_t>(i));
}

TEST_CASE("an index refuses other lengths, NaN, k = 0 and dimension 0") {
  DescriptorIndex index(2);
  check_refused<ShapeError>([&] { index.add(std::vector<float>{1}); }, "1 values");
  check_refused<ShapeError>([&] { index.query(std::vector<float>{1, 2, 3}); }, "3 values");
  check_refused<DataError>([&] { index.add(std::vector<float>{1, std::nanf("")}); }, "position 1");
  check_refused<ConfigError>([&] { index.query(std::vector<float>{1, 2}, 0); }, "k is 0");
  check_refused<ConfigError>([] { DescriptorIndex(0); }, "dimension");
  check_refused<ConfigError>([] { DescriptorIndex(1, {0, -1}); }, "negative");
  check_refused<ShapeError>([&] { index.descriptor(0); }, "descriptor 0 of 0");
  CHECK(index.size() == 0);
}

TEST_CASE("descriptors stay where they are while others are added, also past a chunk") {
  constexpr std::size_t dimension = 5000;
  DescriptorIndex index(dimension);
  index.add(std::vector<float>(dimension, 0.0F));
  const float* first = index.descriptor(0).data();
  for (int i = 1; i < 1000; ++i) {  // 20 MB
    index.add(std::vector<float>(dimension, static_cast<float>(i)));
    index.add(index.descriptor(0));
  }
  CHECK(index.descriptor(0).data() == first);
  CHECK(index.descriptor(1997)[dimension - 1] == 999);
  const auto matches = index.query(std::vector<float>(dimension, 998.9F), 3);
  REQUIRE(matches.size() == 3);
  CHECK(matches[0].index == 1997);
  CHECK(matches[1].index == 1995);
  CHECK(matches[2].index == 1993);
}

TEST_CASE("a copy of an index is one of its own") {
  const auto rows = coarse_rows(300, 7, 6);
  DescriptorIndex index(7);
  for (const auto& row : rows) index.add(row);
  DescriptorIndex copy(index);
  CHECK(same(copy.query(rows[9], 300), index.query(rows[9], 300)));
  copy.add(rows[0]);
  CHECK(index.size() == 300);
  CHECK(copy.size() == 301);
  index = copy;
  CHECK(index.size() == 301);
  CHECK(std::ranges::equal(index.descriptor(300), rows[0]));
}

TEST_CASE("values near the largest float are refused where distances would overflow") {
  constexpr float largest = std::numeric_limits<float>::max();
  DescriptorIndex index(2);
  check_refused<DataError>([&] { index.add(std::vector<float>{1, 0.6F * largest}); },
                           "descriptor 0 is too long");
  check_refused<DataError>([&] { index.query(std::vector<float>{largest, largest}); }, "too long");
  check_refused<DataError>([&] { nearest_causal(std::vector<float>{0, 1, largest, 0}, 2, 0); },
                           "descriptor 1 is too long");
  index.add(std::vector<float>{0.499F * largest, 0});
  index.add(std::vector<float>{0.4F * largest, 0});
  const auto matches = index.query(std::vector<float>{-0.499F * largest, 0}, 2);
  REQUIRE(matches.size() == 2);
  CHECK(matches[0].index == 1);
  CHECK(matches[0].distance == doctest::Approx(0.899 * static_cast<double>(largest)));
  CHECK(std::isfinite(matches[1].distance));
}

TEST_CASE("a batch of queries is the index queried with each, for any number of threads") {
  for (const std::size_t queries : {3U, 90U}) {
    const Rows rows = coarse_rows(200, 6, 7), wanted = coarse_rows(queries, 6, 8);
    DescriptorIndex index(6);
    for (const auto& row : rows) index.add(row);
    for (const int threads : {1, 0, 3}) {
      const auto table = nearest(flat(wanted), flat(rows), 6, 4, threads);
      for (std::size_t q = 0; q < queries; ++q) {
        const auto matches = index.query(wanted[q], 4);
        for (std::size_t rank = 0; rank < 4; ++rank) {
          CHECK(table.indices[4 * q + rank] == matches[rank].index);
          CHECK(table.distances[4 * q + rank] == matches[rank].distance);
        }
      }
    }
  }
}

TEST_CASE("a batch has -1 and infinity where there are too few candidates") {
  const auto table = nearest(std::vector<float>{0, 5}, std::vector<float>{3}, 1, 2);
  CHECK(table.indices == std::vector<std::int64_t>{0, -1, 0, -1});
  constexpr float infinity = std::numeric_limits<float>::infinity();
  CHECK(table.distances == std::vector<float>{3, infinity, 2, infinity});
  CHECK(nearest({}, std::vector<float>{3}, 1).indices.empty());
  CHECK(nearest(std::vector<float>{3}, {}, 1).indices == std::vector<std::int64_t>{-1});
}

TEST_CASE("a batch of causal queries is the index queried row by row, for any number of threads") {
  const Rows rows = coarse_rows(120, 5, 4);
  const auto values = flat(rows);
  for (const std::size_t window : {0U, 7U, 200U}) {
    const auto table = nearest_causal(values, 5, window, 3, 1);
    REQUIRE(table.indices.size() == 120 * 3);
    DescriptorIndex index(5, {window, 0});
    for (std::size_t row = 0; row < rows.size(); ++row) {
      auto matches = index.query(rows[row], 3);
      matches.resize(3, {-1, std::numeric_limits<float>::infinity()});
      for (std::size_t rank = 0; rank < 3; ++rank) {
        CHECK(table.indices[3 * row + rank] == matches[rank].index);
        CHECK(table.distances[3 * row + rank] == matches[rank].distance);
      }
      index.add(rows[row]);
    }
    for (const int threads : {0, 2, 5}) {
      const auto other = nearest_causal(values, 5, window, 3, threads);
      CHECK(other.indices == table.indices);
      CHECK(other.distances == table.distances);
    }
  }
}

TEST_CASE("a batch refuses broken rows, NaN and k = 0") {
  std::vector<float> values{1, 2, 3, 4, 5};
  check_refused<ShapeError>([&] { nearest_causal(values, 2, 0); }, "5 values");
  check_refused<ShapeError>([&] { nearest_causal(values, 0, 0); }, "dimension 0");
  check_refused<ConfigError>([&] { nearest_causal(values, 5, 0, 0); }, "k is 0");
  values[3] = std::nanf("");
  check_refused<DataError>([&] { nearest_causal(values, 1, 0); }, "descriptor 3");
  CHECK(nearest_causal({}, 3, 0).indices.empty());
  const std::vector<float> good{1, 2, 3};
  check_refused<ShapeError>([&] { nearest(good, values, 3); }, "5 values");
  check_refused<DataError>([&] { nearest(values, good, 1); }, "descriptor 3");
  check_refused<DataError>([&] { nearest(good, values, 1); }, "descriptor 3");
  check_refused<ConfigError>([&] { nearest(good, good, 3, 0); }, "k is 0");
}

/// A folder of its own that is removed at the end.
struct Folder {
  fs::path path;

  Folder() {
    std::string name = (fs::temp_directory_path() / "fusionslam-XXXXXX").string();
    REQUIRE(::mkdtemp(name.data()) != nullptr);
    path = name;
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder() { fs::remove_all(path); }

  std::string file(const char* name) const { return (path / name).string(); }
  std::ptrdiff_t files() const {
    return std::distance(fs::directory_iterator(path), fs::directory_iterator());
  }
};

std::string read_bytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void write_bytes(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

DescriptorIndex small_index() {
  DescriptorIndex index(3, {2, 1'500'000'000});
  for (const auto& row : coarse_rows(6, 3, 5))
    index.add(row, 1'000'000'000 * static_cast<std::int64_t>(index.size()));
  return index;
}

TEST_CASE("an index is the same after saving and loading") {
  const Folder folder;
  const auto index = small_index();
  index.save(folder.file("a.index"));
  auto loaded = DescriptorIndex::load(folder.file("a.index"));
  CHECK(folder.files() == 1);
  CHECK(loaded.dimension() == 3);
  CHECK(loaded.window().frames == 2);
  CHECK(loaded.window().nanoseconds == 1'500'000'000);
  REQUIRE(loaded.size() == index.size());
  for (std::size_t i = 0; i < index.size(); ++i)
    CHECK(std::ranges::equal(loaded.descriptor(i), index.descriptor(i)));
  const std::vector<float> query{1, 0, 2};
  CHECK(same(loaded.query(query, 9, 5'000'000'000), index.query(query, 9, 5'000'000'000)));
  loaded.add(query, 6'000'000'000);
  loaded.save(folder.file("a.index"));
  CHECK(DescriptorIndex::load(folder.file("a.index")).size() == index.size() + 1);
}

TEST_CASE("an empty index can be saved") {
  const Folder folder;
  DescriptorIndex(7).save(folder.file("empty.index"));
  const auto loaded = DescriptorIndex::load(folder.file("empty.index"));
  CHECK(loaded.size() == 0);
  CHECK(loaded.dimension() == 7);
}

TEST_CASE("a file cut anywhere is refused by name") {
  const Folder folder;
  const std::string path = folder.file("cut.index");
  small_index().save(path);
  const std::string bytes = read_bytes(path);
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    write_bytes(path, bytes.substr(0, length));
    check_refused<DataError>([&] { DescriptorIndex::load(path); }, path);
  }
  write_bytes(path, bytes.substr(0, bytes.size() / 2));
  check_refused<DataError>([&] { DescriptorIndex::load(path); }, "cut off?");
  write_bytes(path, bytes + "x");
  check_refused<DataError>([&] { DescriptorIndex::load(path); },
                           path + ": 1 byte longer than the 6 descriptors of length 3");
}

TEST_CASE("any flipped bit is noticed and the file refused by name") {
  const Folder folder;
  const std::string path = folder.file("flipped.index");
  small_index().save(path);
  const std::string bytes = read_bytes(path);
  for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    std::string damaged = bytes;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << bit % 8));
    write_bytes(path, damaged);
    check_refused<DataError>([&] { DescriptorIndex::load(path); }, path);
  }
}

TEST_CASE("another version and another kind of file are told apart") {
  const Folder folder;
  const std::string path = folder.file("other.index");
  small_index().save(path);
  std::string bytes = read_bytes(path);
  bytes[8] = 9;
  write_bytes(path, bytes);
  check_refused<DataError>([&] { DescriptorIndex::load(path); }, "version 9");
  bytes[0] = 'X';
  write_bytes(path, bytes);
  check_refused<DataError>([&] { DescriptorIndex::load(path); }, "not a fusionslam");
  check_refused<DataError>([&] { DescriptorIndex::load(folder.file("none")); }, "none");
  check_refused<DataError>([&] { DescriptorIndex::load(folder.path.string()); }, "cannot be read");
}

TEST_CASE("the bytes of an empty index give an empty index") {
  const auto bytes = DescriptorIndex(5, {3, 0}).to_bytes();
  const auto index = DescriptorIndex::from_bytes(bytes);
  CHECK(index.size() == 0);
  CHECK(index.dimension() == 5);
  CHECK(index.to_bytes() == bytes);
}

TEST_CASE("an index of Scan Contexts finds them at any turn, also after a copy and its bytes") {
  constexpr std::size_t rings = 3;
  Rows rows = coarse_rows(12, scan_context_sectors * rings, 3);
  DescriptorIndex index(scan_context_sectors * rings, {}, Metric::scan_context);
  for (const auto& row : rows) index.add(row);
  const DescriptorIndex copy = index;
  const auto restored = DescriptorIndex::from_bytes(index.to_bytes());
  CHECK(restored.metric() == Metric::scan_context);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::vector<float> turned = rows[i];
    std::ranges::rotate(turned, turned.begin() + 7 * rings);
    const auto found = index.query(turned, 12);
    CHECK(found.front().index == static_cast<std::int64_t>(i));
    CHECK(found.front().distance == doctest::Approx(0).epsilon(1e-6));
    CHECK(same(found, copy.query(turned, 12)));
    CHECK(same(found, restored.query(turned, 12)));
  }
  check_refused<ShapeError>([] { DescriptorIndex(61, {}, Metric::scan_context); }, "61");
}

TEST_CASE("a path that cannot be written is named and nothing is left behind") {
  const Folder folder;
  const std::string inside_none = folder.file("none/a.index");
  check_refused<WriteError>([&] { small_index().save(inside_none); }, inside_none);
  fs::create_directory(folder.path / "taken");
  try {
    small_index().save(folder.file("taken"));
    FAIL("a folder was written");
  } catch (const WriteError& error) {
    CHECK(error.path() == folder.file("taken"));
  }
  CHECK(folder.files() == 1);
}

}  // namespace
}  // namespace fusionslam
