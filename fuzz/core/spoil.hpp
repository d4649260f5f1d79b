// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fuzzer/FuzzedDataProvider.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

/// Overwrites, takes out and puts in bytes of a valid file, as the fuzzer's bytes say.
inline void spoil(std::vector<std::uint8_t>& bytes, FuzzedDataProvider& source) {
  const auto write = [&](std::size_t place, const void* from, std::size_t size) {
    std::memcpy(bytes.data() + place, from, std::min(size, bytes.size() - place));
  };
  for (int edits = source.ConsumeIntegralInRange(0, 6); edits > 0 && !bytes.empty(); --edits) {
    const auto place = source.ConsumeIntegralInRange<std::size_t>(0, bytes.size() - 1);
    const auto begin = bytes.begin() + static_cast<std::ptrdiff_t>(place);
    switch (source.ConsumeIntegralInRange(0, 4)) {
      case 0: {
        const auto other = source.ConsumeBytes<std::uint8_t>(source.ConsumeIntegralInRange(1, 8));
        if (!other.empty()) write(place, other.data(), other.size());
        break;
      }
      case 1: {
        const auto number = source.ConsumeIntegralInRange<std::int64_t>(-2, 40);
        write(place / 8 * 8, &number, sizeof(number));
        break;
      }
      case 2: {
        const auto more = source.ConsumeBytes<std::uint8_t>(source.ConsumeIntegralInRange(1, 24));
        bytes.insert(begin, more.begin(), more.end());
        break;
      }
      case 3: {
        const auto count = source.ConsumeIntegralInRange<std::size_t>(1, bytes.size() - place);
        bytes.erase(begin, begin + static_cast<std::ptrdiff_t>(count));
        break;
      }
      default:
        *begin ^= static_cast<std::uint8_t>(1U << source.ConsumeIntegralInRange(0, 7));
    }
  }
}
