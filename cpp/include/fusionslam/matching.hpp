// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "fusionslam/config.hpp"

namespace fusionslam {
namespace detail {
class RowMetric;
}

/// Parts of the full circle of azimuth by which Scan Contexts are divided.
inline constexpr std::size_t scan_context_sectors = 60;

/// How two descriptors are compared; docs/stages/matching.md has lengths, ranges and sources.
/// Index files hold the number, so new ones come last.
enum class Metric {
  l2,              ///< length of the difference
  scan_context,    ///< compare_scan_contexts()
  l1,              ///< sum of the magnitudes of the differences
  chi_square,      ///< of histograms: sum of (a - b)^2 / (a + b)
  regions,         ///< of sets of 308 bins: 1 - (1 + sum of min) / (1 + sum of max) of the best two
  nearest_of_set,  ///< of sets of four: the least l2 of any two
  votes,           ///< of keypoints: 1 - the share of those whose votes agree in space
  aligned_polar,   ///< Scan Context++ at turns near that of the columns' norms
  aligned_cartesian,       ///< the same with lateral shifts
  intensity_scan_context,  ///< 1 - similarity of occupancy x similarity of intensity
  iris,                    ///< of LiDAR Iris: share of bits that differ, at the best turn
  ring,                    ///< of RING: 1 - the largest circular correlation
};

template <>
struct ChoiceNames<Metric> {
  static constexpr std::array<std::string_view, 12> value{"l2",
                                                          "scan_context",
                                                          "l1",
                                                          "chi_square",
                                                          "regions",
                                                          "nearest_of_set",
                                                          "votes",
                                                          "aligned_polar",
                                                          "aligned_cartesian",
                                                          "intensity_scan_context",
                                                          "iris",
                                                          "ring"};
};

/// Recent past that is left out of the search for a query.
struct ExclusionWindow {
  std::size_t frames = 0;        ///< candidates are older by more than this many frames ...
  std::int64_t nanoseconds = 0;  ///< ... and by more than this time; 0 switches the test off
};

struct Match {
  std::int64_t index;  ///< of the descriptor, in the order of adding
  float distance;
};

/// Exact, causal nearest neighbours over descriptors of one length.
///
/// A query is answered as if it were the next descriptor to be added, number size(): only older
/// ones outside the exclusion window are candidates. Equal distances go to the lowest index.
/// Threads may share it through const members while none changes it.
class DescriptorIndex {
 public:
  /// Throws ConfigError if dimension is 0 or the window is negative, and ShapeError if the metric
  /// is for descriptors of other lengths.
  explicit DescriptorIndex(std::size_t dimension, ExclusionWindow window = {},
                           Metric metric = Metric::l2);
  ~DescriptorIndex();
  DescriptorIndex(const DescriptorIndex& other);
  DescriptorIndex& operator=(const DescriptorIndex& other);
  DescriptorIndex(DescriptorIndex&&) noexcept;
  DescriptorIndex& operator=(DescriptorIndex&&) noexcept;

  /// Returns the index given to the descriptor. Throws ShapeError or DataError (NaN, infinity, so
  /// long that distances might exceed the largest float, or values that have no meaning in the
  /// metric), and ConfigError if the window needs a stamp and none is given.
  std::int64_t add(std::span<const float> descriptor,
                   std::optional<std::int64_t> stamp_ns = std::nullopt);

  /// The k nearest candidates, nearest first; fewer if there are fewer.
  /// Throws ShapeError or DataError, and ConfigError if the window needs a stamp and none is given.
  std::vector<Match> query(std::span<const float> descriptor, std::size_t k = 1,
                           std::optional<std::int64_t> stamp_ns = std::nullopt) const;

  /// Writes one file, whole or not at all. Throws WriteError.
  void save(const std::string& path) const;

  /// Throws DataError naming the path if the file is not an index, of another version, cut or
  /// damaged.
  static DescriptorIndex load(const std::string& path);

  /// The content of such a file, to send to another process.
  std::vector<std::uint8_t> to_bytes() const;

  /// Throws DataError as load() does.
  static DescriptorIndex from_bytes(std::span<const std::uint8_t> bytes);

  std::size_t size() const { return stamps_ns_.size(); }
  std::size_t dimension() const;
  ExclusionWindow window() const { return window_; }
  Metric metric() const { return metric_; }
  /// Stays where it is while descriptors are added.
  std::span<const float> descriptor(std::size_t i) const;

 private:
  struct Rows;

  template <class Sink>
  void write(Sink& sink) const;
  template <class Source>
  static DescriptorIndex read(Source&& source);
  void check_content(const std::string& name) const;
  void append_cache(std::span<const float> descriptor);
  std::vector<Match> query_rows(std::span<const float> descriptor, std::size_t k,
                                std::optional<std::int64_t> stamp_ns, std::size_t end) const;

  void check_descriptor(std::span<const float> descriptor) const;
  void check_stamp(std::optional<std::int64_t> stamp_ns) const;
  bool is_old_enough(std::size_t i, std::optional<std::int64_t> stamp_ns) const;

  ExclusionWindow window_;
  Metric metric_;
  std::unique_ptr<Rows> rows_;
  std::shared_ptr<const detail::RowMetric> row_metric_;  ///< none for l2
  std::unique_ptr<Rows> caches_;                         ///< what the metric prepares of rows
  std::vector<std::int64_t> stamps_ns_;
};

/// Row-major results of a batch of queries: `k` columns, -1 and infinity where there is none.
struct MatchTable {
  std::size_t k = 0;
  std::vector<std::int64_t> indices;
  std::vector<float> distances;
};

/// For each row of `queries` the k nearest rows of `descriptors`, both row-major with `dimension`
/// columns. Equal distances go to the lowest index; the result does not depend on `threads` (0:
/// all cores). Throws ShapeError, ConfigError or DataError as DescriptorIndex does.
MatchTable nearest(std::span<const float> queries, std::span<const float> descriptors,
                   std::size_t dimension, std::size_t k = 1, int threads = 0,
                   Metric metric = Metric::l2);

/// For each row i of `descriptors` (row-major, `dimension` columns) its k nearest rows
/// j < i - window, as if the rows had been added and queried one after the other.
/// The result does not depend on `threads` (0: all cores).
MatchTable nearest_causal(std::span<const float> descriptors, std::size_t dimension,
                          std::size_t window, std::size_t k = 1, int threads = 0,
                          Metric metric = Metric::l2);

/// How alike two descriptors are, and the turn between them where the metric finds one.
struct DescriptorMatch {
  float distance;
  std::optional<double> yaw;  ///< of the query's frame in the match's, radians
};

/// Compares two descriptors as an index of the metric does.
/// Throws ShapeError or DataError as DescriptorIndex does.
DescriptorMatch compare_descriptors(std::span<const float> query, std::span<const float> match,
                                    Metric metric);

/// How alike two Scan Contexts are, and the turn between them.
struct TurnedMatch {
  float distance;  ///< 0 to 1 for entries >= 0
  double yaw;      ///< of the query's frame in the match's, radians, above -pi to pi
};

/// Compares two Scan Contexts (Kim, Kim, IROS 2018, equations 6 and 7): 1 - the sum
/// over the sectors of their cosines, divided by the sectors that are filled in the fuller one, at
/// the turn where that is least. The paper divides by all sectors, which is the same for scans of
/// the full circle. Divided by those filled in both, any two slivers of narrow ones would look
/// alike. Throws ShapeError or DataError as DescriptorIndex does.
TurnedMatch compare_scan_contexts(std::span<const float> query, std::span<const float> match);

}  // namespace fusionslam
