// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <string>

#include "fusionslam/errors.hpp"
#include "fusionslam/matching.hpp"
#include "nearest.hpp"

namespace fusionslam {
namespace {

void check_descriptor(std::span<const float> descriptor, std::size_t dimension, std::size_t row) {
  if (descriptor.size() != dimension)
    throw ShapeError("descriptor has " + std::to_string(descriptor.size()) +
                     " values, this index holds " + std::to_string(dimension));
  detail::check_finite(descriptor, row);
}

}  // namespace

DescriptorIndex::DescriptorIndex(std::size_t dimension, ExclusionWindow window)
    : dimension_(dimension), window_(window) {
  if (dimension == 0) throw ConfigError("dimension is 0, expected at least 1");
  if (window.nanoseconds < 0) throw ConfigError("window in seconds is negative, expected >= 0");
}

std::int64_t DescriptorIndex::add(std::span<const float> descriptor,
                                  std::optional<std::int64_t> stamp_ns) {
  check_descriptor(descriptor, dimension_, size());
  check_stamp(stamp_ns);
  const std::vector<float> copy(descriptor.begin(), descriptor.end());  // it may be one of ours
  descriptors_.insert(descriptors_.end(), copy.begin(), copy.end());
  stamps_ns_.push_back(stamp_ns.value_or(0));
  return static_cast<std::int64_t>(size() - 1);
}

std::vector<Match> DescriptorIndex::query(std::span<const float> descriptor, std::size_t k,
                                          std::optional<std::int64_t> stamp_ns) const {
  check_descriptor(descriptor, dimension_, size());
  if (k == 0) throw ConfigError("k is 0, expected at least 1");
  check_stamp(stamp_ns);
  detail::NearestK nearest(k);
  for (std::size_t i = 0; i < size(); ++i)
    if (is_candidate(i, stamp_ns))
      nearest.offer(static_cast<std::int64_t>(i),
                    detail::squared_distance(descriptor.data(),
                                             descriptors_.data() + i * dimension_, dimension_));
  return nearest.matches();
}

std::span<const float> DescriptorIndex::descriptor(std::size_t i) const {
  if (i >= size())
    throw ShapeError("descriptor " + std::to_string(i) + " of " + std::to_string(size()));
  return {descriptors_.data() + i * dimension_, dimension_};
}

void DescriptorIndex::check_stamp(std::optional<std::int64_t> stamp_ns) const {
  if (window_.nanoseconds > 0 && !stamp_ns)
    throw ConfigError("stamp_ns is missing: this index excludes a window in seconds");
}

bool DescriptorIndex::is_candidate(std::size_t i, std::optional<std::int64_t> stamp_ns) const {
  if (size() - i <= window_.frames) return false;
  if (window_.nanoseconds == 0) return true;
  // Unsigned, because the difference of any two stamps need not fit a signed one.
  const auto age =
      static_cast<std::uint64_t>(*stamp_ns) - static_cast<std::uint64_t>(stamps_ns_[i]);
  return *stamp_ns > stamps_ns_[i] && age > static_cast<std::uint64_t>(window_.nanoseconds);
}

}  // namespace fusionslam
