// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Cases computed by hand; tests/python/matching compares with NumPy.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/matching.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;
using Row = std::vector<float>;

float distance(const Row& query, const Row& match, Metric metric) {
  const DescriptorMatch found = compare_descriptors(query, match, metric);
  CHECK(compare_descriptors(query, query, metric).distance == doctest::Approx(0).epsilon(1e-6));
  return found.distance;
}

TEST_CASE("l2 and l1 of two descriptors are the lengths of their difference") {
  CHECK(distance({1, -2, 0}, {4, 2, 0}, Metric::l2) == 5);
  CHECK(distance({1, -2, 0}, {4, 2, 0}, Metric::l1) == 7);
  CHECK(!compare_descriptors(Row{1}, Row{2}, Metric::l1).yaw);
  constexpr float largest = std::numeric_limits<float>::max();
  check_refused<DataError>([&] { distance(Row(9, largest / 10), Row(9), Metric::l1); },
                           "descriptor 0 is too long for metric l1");
}

TEST_CASE("chi_square divides by the sum of each bin and leaves out empty ones") {
  CHECK(distance({1, 0, 3, 2}, {3, 0, 1, 0}, Metric::chi_square) == 1 + 1 + 2);
  check_refused<DataError>([] { distance({1, 0}, {0, -0.5F}, Metric::chi_square); },
                           "descriptor 1 is -0.500000 at position 1, metric chi_square");
}

TEST_CASE("regions are compared by the two that are most alike") {
  Row query(2 * 308), match(3 * 308);
  query[0] = 2;
  query[308] = 6;
  match.resize(2 * 308);
  match[308] = 5;  // its first block is absent
  CHECK(distance(query, match, Metric::regions) == doctest::Approx(1 - 6.0 / 7));
  match[309] = 1;
  CHECK(distance(query, match, Metric::regions) == doctest::Approx(1 - 6.0 / 8));
  check_refused<DataError>([&] { distance(query, Row(2 * 308), Metric::regions); },
                           "descriptor 1 is an empty set");
  check_refused<ShapeError>([] { distance(Row(309, 1), Row(309, 1), Metric::regions); },
                            "309 values, metric regions takes multiples of 308");
  check_refused<DataError>([] { distance(Row(308, -1), Row(308, 1), Metric::regions); }, "-1");
}

TEST_CASE("the nearest members of two sets are compared, absent ones left out") {
  const Row query{1, 1, 0, 0, 9, 9, 0, 0}, match{0, 0, 6, 5, 0, 0, 0, 0};
  CHECK(distance(query, match, Metric::nearest_of_set) == 5);
  check_refused<DataError>([&] { distance(query, Row(8), Metric::nearest_of_set); }, "empty set");
  check_refused<ShapeError>([] { distance(Row(6, 1), Row(6, 1), Metric::nearest_of_set); }, "6");
}

/// A row whose columns are those of another from `shift` on, around the circle.
Row turned(const Row& row, std::size_t columns, std::size_t shift) {
  Row result = row;
  std::ranges::rotate(result,
                      result.begin() + static_cast<std::ptrdiff_t>(shift * (row.size() / columns)));
  return result;
}

Row random_row(std::size_t size, unsigned seed, unsigned below = 100) {
  std::mt19937 random(seed);
  Row row(size);
  for (auto& value : row) value = static_cast<float>(random() % below);
  return row;
}

TEST_CASE("metrics with a turn find it") {
  struct Turning {
    Metric metric;
    std::size_t columns, bins;
    double period;
  };
  for (const auto& [metric, columns, bins, period] :
       {Turning{Metric::scan_context, 60, 5, 2 * std::numbers::pi},
        Turning{Metric::aligned_polar, 60, 5, 2 * std::numbers::pi},
        Turning{Metric::intensity_scan_context, 60, 5, 2 * std::numbers::pi},
        Turning{Metric::iris, 360, 6, 2 * std::numbers::pi},
        Turning{Metric::ring, 120, 5, std::numbers::pi}}) {
    CAPTURE(choice_name(metric));
    const Row row = random_row(columns * bins, 8);
    for (const std::size_t shift : {1U, 17U, 59U}) {
      const auto found = compare_descriptors(turned(row, columns, shift), row, metric);
      CHECK(found.distance == doctest::Approx(0).epsilon(1e-6));
      // What was `shift` columns to the left of the match is ahead of the query.
      const double yaw = period * static_cast<double>(shift) / static_cast<double>(columns);
      CHECK(std::remainder(found.yaw.value() - yaw, period) == doctest::Approx(0).epsilon(1e-9));
      CHECK(std::abs(found.yaw.value()) <= period / 2);
    }
  }
}

TEST_CASE("votes count where the distances between keypoints agree within a metre") {
  constexpr std::size_t keypoint = 66;
  const auto two_keypoints = [](float x, float y) {
    Row row(3 * keypoint);  // the last one is absent
    row[0] = row[keypoint + 1] = 1;
    row[keypoint + 64] = x;
    row[keypoint + 65] = y;
    return row;
  };
  const Row query = two_keypoints(10, 0);
  CHECK(distance(query, two_keypoints(0, 10.9F), Metric::votes) == 0);
  CHECK(distance(query, two_keypoints(0, 11.1F), Metric::votes) == 0.5F);
  check_refused<DataError>([&] { distance(query, Row(198), Metric::votes); }, "empty set");
  check_refused<ShapeError>([] { distance(Row(67, 1), Row(67, 1), Metric::votes); }, "67");
}

TEST_CASE("only the five keypoints nearest to one of the query vote") {
  Row query(66), far(66);
  query[0] = far[0] = 1;
  far[1] = 0.5F;
  DescriptorIndex index(66, {}, Metric::votes);
  index.add(far);
  for (int i = 0; i < 6; ++i) index.add(query);
  const auto found = index.query(query, 7);
  REQUIRE(found.size() == 7);
  for (std::size_t i = 0; i < 5; ++i) {
    CHECK(found[i].index == static_cast<std::int64_t>(i) + 1);
    CHECK(found[i].distance == 0);
  }
  CHECK(found[5].index == 0);
  CHECK(found[6].index == 6);
  CHECK(found[6].distance == 1);
}

TEST_CASE("lateral shifts do not come back at the other side") {
  Row row(40), shifted(40);
  for (std::size_t i : {0U, 1U, 10U, 20U, 21U, 30U}) row[i] = static_cast<float>(i % 7 + 1);
  std::copy(row.begin() + 2, row.end(), shifted.begin());
  CHECK(distance(shifted, row, Metric::aligned_cartesian) == doctest::Approx(1 - 4.0 / 6));
  CHECK(!compare_descriptors(row, row, Metric::aligned_cartesian).yaw);
}

TEST_CASE("occupancy and intensity are multiplied") {
  Row query(60), match(60);
  query[0] = query[1] = query[2] = 1;
  match[0] = match[1] = 5;
  CHECK(distance(query, match, Metric::intensity_scan_context) ==
        doctest::Approx(1 - 59.0 / 60 * 2 / 3));
  check_refused<DataError>([&] { distance(query, Row(60, -1), Metric::intensity_scan_context); },
                           "-1");
  CHECK(compare_descriptors(query, Row(60), Metric::intensity_scan_context).distance == 1);
}

TEST_CASE("of the bits of an iris those valid in both count") {
  Row query(720), match(720);
  for (std::size_t column = 0; column < 720; column += 2) {
    query[column + 1] = 0x00ff;
    match[column] = 0x1f1e;  // four bits differ, one of them where both are valid
    match[column + 1] = 0x0ff0;
  }
  CHECK(distance(query, match, Metric::iris) == 0.25F);
  CHECK(compare_descriptors(query, Row(720), Metric::iris).distance == 1);
  match[5] = 0.5F;
  check_refused<DataError>([&] { distance(query, match, Metric::iris); }, "0.500000 at position 5");
  check_refused<DataError>([&] { distance(query, Row(720, 65536), Metric::iris); }, "65536");
  check_refused<ShapeError>([] { distance(Row(360), Row(360), Metric::iris); }, "720");
}

TEST_CASE("ring is one less the largest correlation of the angles") {
  Row query(120), match(120);
  query[0] = 2;
  match[30] = match[40] = 3;
  CHECK(distance(query, match, Metric::ring) == doctest::Approx(1 - std::sqrt(0.5)));
  CHECK(compare_descriptors(query, Row(120), Metric::ring).distance == 1);
}

TEST_CASE("descriptors of other lengths, of none and with NaN are refused") {
  check_refused<ShapeError>([] { distance({1}, {1, 2}, Metric::l1); }, "1 and 2 values");
  check_refused<ShapeError>([] { compare_descriptors({}, {}, Metric::l2); }, "no values");
  check_refused<DataError>([] { distance({1}, {std::nanf("")}, Metric::l1); }, "descriptor 1");
}

/// Rows that each metric takes.
struct Sample {
  Metric metric;
  std::size_t dimension;
};

Row sample_row(const Sample& sample, std::mt19937& random) {
  Row row(sample.dimension);
  for (auto& value : row) value = static_cast<float>(random() % 3);
  return row;
}

const std::vector<Sample> samples{
    {Metric::scan_context, 180},
    {Metric::l1, 5},
    {Metric::chi_square, 5},
    {Metric::regions, 616},
    {Metric::nearest_of_set, 8},
    {Metric::aligned_polar, 180},
    {Metric::aligned_cartesian, 120},
    {Metric::intensity_scan_context, 180},
    {Metric::iris, 2160},
    {Metric::ring, 360},
    {Metric::votes, 198},
};

TEST_CASE("an index of any metric answers like a batch and like pairs, also after its bytes") {
  for (const Sample& sample : samples) {
    CAPTURE(choice_name(sample.metric));
    std::mt19937 random(5);
    constexpr std::size_t count = 40, window = 3, k = 4;
    DescriptorIndex index(sample.dimension, {window, 0}, sample.metric);
    std::vector<Row> rows;
    Row values;
    for (std::size_t i = 0; i < count; ++i) {
      rows.push_back(i % 7 == 6 ? rows[i / 2] : sample_row(sample, random));  // ties
      values.insert(values.end(), rows.back().begin(), rows.back().end());
    }
    const auto causal = nearest_causal(values, sample.dimension, window, k, 1, sample.metric);
    const auto threaded = nearest_causal(values, sample.dimension, window, k, 3, sample.metric);
    CHECK(causal.indices == threaded.indices);
    CHECK(causal.distances == threaded.distances);
    for (std::size_t i = 0; i < count; ++i) {
      auto matches = index.query(rows[i], k);
      CHECK(std::ranges::is_sorted(matches, {}, &Match::distance));
      for (const auto& match : matches)
        if (sample.metric != Metric::votes)  // there candidates compete for votes
          CHECK(match.distance == compare_descriptors(rows[i],
                                                      rows[static_cast<std::size_t>(match.index)],
                                                      sample.metric)
                                      .distance);
      matches.resize(k, {-1, std::numeric_limits<float>::infinity()});
      for (std::size_t rank = 0; rank < k; ++rank) {
        CHECK(matches[rank].index == causal.indices[i * k + rank]);
        CHECK(matches[rank].distance == causal.distances[i * k + rank]);
      }
      index.add(rows[i]);
    }
    const auto restored = DescriptorIndex::from_bytes(index.to_bytes());
    CHECK(restored.metric() == sample.metric);
    CHECK(restored.to_bytes() == index.to_bytes());
    const DescriptorIndex copy = restored;
    const auto expected = index.query(rows[9], count), found = copy.query(rows[9], count);
    REQUIRE(found.size() == expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
      CHECK(found[i].index == expected[i].index);
      CHECK(found[i].distance == expected[i].distance);
    }
  }
}

TEST_CASE("files hold the number of the metric, and one that is unknown is refused") {
  constexpr std::size_t metric_at = 48;  // after the header
  auto bytes = DescriptorIndex(60, {}, Metric::scan_context).to_bytes();
  CHECK(bytes[metric_at] == 1);
  bytes[metric_at] = 99;
  check_refused<DataError>([&] { DescriptorIndex::from_bytes(bytes); }, "metric 99");
  bytes[metric_at] = 10;  // iris, whose rows are longer
  check_refused<DataError>([&] { DescriptorIndex::from_bytes(bytes); }, "metric iris");
}

}  // namespace
}  // namespace fusionslam
