// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Packs numbers of few bits into bytes, in which scenes are stored.
#pragma once

#include <bit>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "fusionslam/errors.hpp"

namespace fusionslam::detail {

using Bytes = std::vector<std::uint8_t>;

[[noreturn]] inline void refuse_bytes(const std::string& why) {
  throw DataError("bytes of a scene: " + why);
}

inline void append_varint(Bytes& bytes, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) bytes.push_back(static_cast<std::uint8_t>(value | 0x80));
  bytes.push_back(static_cast<std::uint8_t>(value));
}

inline std::uint64_t take_varint(std::span<const std::uint8_t>& bytes) {
  std::uint64_t value = 0;
  for (int shift = 0; shift < 63; shift += 7) {
    if (bytes.empty()) refuse_bytes("cut off");
    const std::uint8_t byte = bytes.front();
    bytes = bytes.subspan(1);
    value |= static_cast<std::uint64_t>(byte & 0x7f) << shift;
    if (byte < 0x80) return value;
  }
  refuse_bytes("damaged number");
}

/// Whole numbers of either sign as those without one: 0, -1, 1, -2, 2 become 0, 1, 2, 3, 4.
inline std::uint64_t fold(std::int64_t value) {
  return (static_cast<std::uint64_t>(value) << 1) ^ static_cast<std::uint64_t>(value >> 63);
}

inline std::int64_t unfold(std::uint64_t value) {
  return static_cast<std::int64_t>(value >> 1) ^ -static_cast<std::int64_t>(value & 1);
}

class BitWriter {
 public:
  explicit BitWriter(Bytes& bytes) : bytes_(bytes) {}
  void write(std::uint64_t value, int bits) {
    for (int i = 0; i < bits; ++i, ++used_) {
      if (used_ % 8 == 0) bytes_.push_back(0);
      bytes_.back() |= static_cast<std::uint8_t>(((value >> i) & 1) << (used_ % 8));
    }
  }
  /// Small numbers in few bits: an exponential Golomb code of the given order.
  void write_small(std::uint64_t value, int order) {
    const std::uint64_t high = (value >> order) + 1;
    const int width = std::bit_width(high);
    write(0, width - 1);
    write(1, 1);
    write(high & ~(std::uint64_t{1} << (width - 1)), width - 1);
    write(value, order);
  }

 private:
  Bytes& bytes_;
  std::size_t used_ = 0;
};

class BitReader {
 public:
  explicit BitReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  std::uint64_t read(int bits) {
    std::uint64_t value = 0;
    for (int i = 0; i < bits; ++i, ++used_) {
      if (used_ / 8 >= bytes_.size()) refuse_bytes("too short for what it should hold");
      value |= static_cast<std::uint64_t>((bytes_[used_ / 8] >> (used_ % 8)) & 1) << i;
    }
    return value;
  }
  std::uint64_t read_small(int order) {
    int width = 0;
    while (read(1) == 0)
      if (++width > 40) refuse_bytes("damaged number");
    const std::uint64_t high = (std::uint64_t{1} << width) | read(width);
    return ((high - 1) << order) | read(order);
  }
  std::size_t bytes_used() const { return (used_ + 7) / 8; }
  std::size_t bits_left() const { return 8 * bytes_.size() - used_; }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t used_ = 0;
};

}  // namespace fusionslam::detail
