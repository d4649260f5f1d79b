// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Bits that differ between two rows of bits, of which only some are valid.
#pragma once

#include <cstddef>
#include <cstdint>

#include "../detail/simd.hpp"

namespace fusionslam::detail {

/// Words are compared in blocks of this many.
constexpr std::size_t bit_block = 32;

struct BitCounts {
  std::size_t valid;      ///< in both
  std::size_t differing;  ///< of those
};

/// Compares `words` words of 64 bits, whole blocks.
using CountBits = BitCounts (*)(const std::uint64_t* bits, const std::uint64_t* mask,
                                const std::uint64_t* other_bits, const std::uint64_t* other_mask,
                                std::size_t words);

CountBits bit_kernel(SimdLevel level);

}  // namespace fusionslam::detail
