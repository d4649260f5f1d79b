// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <string>

#include "direct_search.hpp"
#include "fusionslam/errors.hpp"
#include "metrics/row_metric.hpp"
#include "row_chunks.hpp"

namespace fusionslam {
namespace {

std::size_t check_dimension(std::size_t dimension) {
  if (dimension == 0) throw ConfigError("dimension is 0, expected at least 1");
  return dimension;
}

}  // namespace

DescriptorIndex::DescriptorIndex(std::size_t dimension, ExclusionWindow window, Metric metric)
    : window_(window), metric_(metric), rows_(std::make_unique<Rows>(check_dimension(dimension))) {
  if (window.nanoseconds < 0) throw ConfigError("window in seconds is negative, expected >= 0");
  row_metric_ = detail::make_row_metric(metric, dimension);
  if (row_metric_ && row_metric_->cache_size() > 0)
    caches_ = std::make_unique<Rows>(row_metric_->cache_size());
}

DescriptorIndex::~DescriptorIndex() = default;
DescriptorIndex::DescriptorIndex(const DescriptorIndex& other)
    : window_(other.window_),
      metric_(other.metric_),
      rows_(std::make_unique<Rows>(*other.rows_)),
      row_metric_(other.row_metric_),
      caches_(other.caches_ ? std::make_unique<Rows>(*other.caches_) : nullptr),
      stamps_ns_(other.stamps_ns_) {}
DescriptorIndex& DescriptorIndex::operator=(const DescriptorIndex& other) {
  return *this = DescriptorIndex(other);
}
DescriptorIndex::DescriptorIndex(DescriptorIndex&&) noexcept = default;
DescriptorIndex& DescriptorIndex::operator=(DescriptorIndex&&) noexcept = default;

std::size_t DescriptorIndex::dimension() const { return rows_->dimension(); }

std::int64_t DescriptorIndex::add(std::span<const float> descriptor,
                                  std::optional<std::int64_t> stamp_ns) {
  check_descriptor(descriptor);
  check_stamp(stamp_ns);
  stamps_ns_.push_back(stamp_ns.value_or(0));
  try {
    rows_->append(descriptor);
    append_cache(descriptor);
  } catch (...) {
    stamps_ns_.pop_back();
    rows_->truncate(size());
    if (caches_) caches_->truncate(size());
    throw;
  }
  return static_cast<std::int64_t>(size() - 1);
}

void DescriptorIndex::append_cache(std::span<const float> descriptor) {
  if (caches_) row_metric_->prepare(descriptor, caches_->append_rows(1));
}

std::vector<Match> DescriptorIndex::query(std::span<const float> descriptor, std::size_t k,
                                          std::optional<std::int64_t> stamp_ns) const {
  check_descriptor(descriptor);
  if (k == 0) throw ConfigError("k is 0, expected at least 1");
  check_stamp(stamp_ns);
  // The last window_.frames are no candidates in any case.
  const std::size_t end = size() - std::min(size(), window_.frames);
  if (row_metric_) return query_rows(descriptor, k, stamp_ns, end);
  detail::DirectSearch search(
      descriptor, k, [&](std::size_t i) { return rows_->row(i).data(); }, simd_level());
  for (std::size_t begin = 0; begin < end; begin += rows_->chunk_rows())
    search.scan(begin, std::min(begin + rows_->chunk_rows(), end),
                [&](std::size_t i) { return is_old_enough(i, stamp_ns); });
  return search.matches();
}

std::vector<Match> DescriptorIndex::query_rows(std::span<const float> descriptor, std::size_t k,
                                               std::optional<std::int64_t> stamp_ns,
                                               std::size_t end) const {
  std::vector<detail::Candidate> candidates;
  candidates.reserve(end);
  for (std::size_t i = 0; i < end; ++i)
    if (is_old_enough(i, stamp_ns))
      candidates.push_back({static_cast<std::int64_t>(i), rows_->row(i).data(),
                            caches_ ? caches_->row(i).data() : nullptr});
  return row_metric_->query(descriptor)->nearest(candidates, k);
}

std::span<const float> DescriptorIndex::descriptor(std::size_t i) const {
  if (i >= size())
    throw ShapeError("descriptor " + std::to_string(i) + " of " + std::to_string(size()));
  return rows_->row(i);
}

void DescriptorIndex::check_descriptor(std::span<const float> descriptor) const {
  if (descriptor.size() != dimension())
    throw ShapeError("descriptor has " + std::to_string(descriptor.size()) +
                     " values, this index holds " + std::to_string(dimension()));
  detail::check_row(row_metric_.get(), descriptor, size());
}

void DescriptorIndex::check_stamp(std::optional<std::int64_t> stamp_ns) const {
  if (window_.nanoseconds > 0 && !stamp_ns)
    throw ConfigError("stamp_ns is missing: this index excludes a window in seconds");
}

bool DescriptorIndex::is_old_enough(std::size_t i, std::optional<std::int64_t> stamp_ns) const {
  if (window_.nanoseconds == 0) return true;
  // Unsigned, because the difference of any two stamps need not fit a signed one.
  const auto age =
      static_cast<std::uint64_t>(*stamp_ns) - static_cast<std::uint64_t>(stamps_ns_[i]);
  return *stamp_ns > stamps_ns_[i] && age > static_cast<std::uint64_t>(window_.nanoseconds);
}

}  // namespace fusionslam
