// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Places by the votes of keypoints (Bosse, Zlot, ICRA 2013, section IV): each keypoint of the query
// votes for the places of the keypoints that are most alike among those of all candidates.
#include <cmath>

#include "../direct_search.hpp"
#include "../row_chunks.hpp"
#include "block_sets.hpp"
#include "metrics.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t description_size = 64;
constexpr std::size_t keypoint_size = description_size + 2;  // then x and y in metres
constexpr std::size_t votes_each = 5;
constexpr double tolerance = 1;  // metres by which distances between keypoints may differ

struct Position {
  double x, y;
};

double distance_of(Position a, Position b) { return std::hypot(a.x - b.x, a.y - b.y); }

/// A keypoint of the query and one of a candidate that is like it.
struct Vote {
  std::size_t place;  ///< number of the candidate
  std::size_t from, to;
  Position seen, stored;

  bool agrees_with(const Vote& other) const {
    return from != other.from && to != other.to &&
           std::abs(distance_of(seen, other.seen) - distance_of(stored, other.stored)) <= tolerance;
  }
};

/// The size of the largest set of votes that agree in pairs, as found from each vote in turn by
/// adding all others that agree with those added so far, in their order.
std::size_t count_consistent(std::span<const Vote> votes) {
  std::size_t most = 0;
  std::vector<const Vote*> chosen;
  for (const Vote& first : votes) {
    chosen.assign(1, &first);
    for (const Vote& vote : votes)
      if (std::ranges::all_of(chosen, [&](const Vote* other) { return vote.agrees_with(*other); }))
        chosen.push_back(&vote);
    most = std::max(most, chosen.size());
  }
  return most;
}

/// Keypoints of a row without those that are absent: their number, descriptions, positions.
class Keypoints {
 public:
  static std::size_t size(std::size_t dimension) { return first + dimension; }

  static void write(std::span<const float> row, std::span<float> keypoints) {
    float* description = keypoints.data() + first;
    float* position = description + row.size() / keypoint_size * description_size;
    visit_blocks(row, keypoint_size, [&](std::span<const float> block) {
      description = std::copy_n(block.data(), description_size, description);
      position = std::copy_n(block.data() + description_size, 2, position);
      keypoints[0] += 1;
    });
  }

  Keypoints(const float* written, std::size_t dimension)
      : count_(static_cast<std::size_t>(written[0])),
        descriptions_(written + first),
        positions_(descriptions_ + dimension / keypoint_size * description_size) {}

  std::size_t count() const { return count_; }
  const float* description(std::size_t i) const { return descriptions_ + i * description_size; }
  Position position(std::size_t i) const {
    return {static_cast<double>(positions_[2 * i]), static_cast<double>(positions_[2 * i + 1])};
  }

 private:
  static constexpr std::size_t first = 16;  // so that descriptions begin at a cache line
  std::size_t count_;
  const float* descriptions_;
  const float* positions_;
};

class Votes final : public RowMetric {
 public:
  explicit Votes(std::size_t dimension) : RowMetric(dimension) {
    check_multiple("votes", dimension, keypoint_size);
  }

  void check(std::span<const float> row, std::size_t number) const override {
    check_blocks("votes", row, keypoint_size, number);
  }

  std::size_t cache_size() const override { return Keypoints::size(dimension()); }

  void prepare(std::span<const float> row, std::span<float> cache) const override {
    Keypoints::write(row, cache);
  }

  std::unique_ptr<RowQuery> query(std::span<const float> row) const override;
};

class VotesQuery final : public RowQuery {
 public:
  VotesQuery(const Votes& metric, std::span<const float> query)
      : dimension_(query.size()), written_(metric.cache_size()) {
    metric.prepare(query, written_);
  }

  Distance compare(const Candidate& candidate) override {
    return {distance_of_votes(find_votes(std::span(&candidate, 1)))};
  }

  std::vector<Match> nearest(std::span<const Candidate> candidates, std::size_t k) override {
    const std::vector<Vote> votes = find_votes(candidates);
    NearestK found(k);
    auto begin = votes.begin();
    for (std::size_t place = 0; place < candidates.size(); ++place) {
      const auto end = std::ranges::find_if(begin, votes.end(),
                                            [&](const Vote& vote) { return vote.place != place; });
      const double distance = distance_of_votes(std::span(begin, end));
      found.offer(candidates[place].index, distance * distance);
      begin = end;
    }
    return found.matches();
  }

 private:
  double distance_of_votes(std::span<const Vote> votes) const {
    const auto keypoints = static_cast<double>(Keypoints(written_.data(), dimension_).count());
    return 1 - static_cast<double>(count_consistent(votes)) / keypoints;
  }

  /// Place by place, the votes of each in the order of the query's keypoints.
  std::vector<Vote> find_votes(std::span<const Candidate> candidates) const {
    const std::size_t blocks = dimension_ / keypoint_size;  // of each candidate
    const auto keypoints_of = [&](std::size_t place) {
      return Keypoints(candidates[place].cache, dimension_);
    };
    const auto description_of = [&](std::size_t i) {
      return keypoints_of(i / blocks).description(i % blocks);
    };
    const Keypoints query(written_.data(), dimension_);
    std::vector<Vote> votes;
    for (std::size_t from = 0; from < query.count(); ++from) {
      DirectSearch search({query.description(from), description_size}, votes_each, description_of,
                          simd_level());
      for (std::size_t place = 0; place < candidates.size(); ++place)
        search.scan(place * blocks, place * blocks + keypoints_of(place).count(),
                    [](std::size_t) { return true; });
      for (const Match& match : search.matches()) {
        const auto at = static_cast<std::size_t>(match.index);
        votes.push_back({at / blocks, from, at % blocks, query.position(from),
                         keypoints_of(at / blocks).position(at % blocks)});
      }
    }
    std::ranges::stable_sort(votes, {}, &Vote::place);
    return votes;
  }

  std::size_t dimension_;
  AlignedFloats written_;
};

std::unique_ptr<RowQuery> Votes::query(std::span<const float> row) const {
  return std::make_unique<VotesQuery>(*this, row);
}

}  // namespace

MetricPointer votes_metric(std::size_t dimension) { return std::make_unique<Votes>(dimension); }

}  // namespace fusionslam::detail
