// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "bit_kernel.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t lanes = 4;
constexpr std::size_t together = bit_block / lanes;

typedef std::uint64_t Words __attribute__((vector_size(lanes * 8), may_alias));
typedef Words UnalignedWords __attribute__((aligned(8)));

FUSIONSLAM_INLINE const UnalignedWords& load(const std::uint64_t* words) {
  return *reinterpret_cast<const UnalignedWords*>(words);
}

FUSIONSLAM_INLINE void add_ones(const Words& words, Words& sum) {
  Words x = words - ((words >> 1) & 0x5555555555555555U);
  x = (x & 0x3333333333333333U) + ((x >> 2) & 0x3333333333333333U);
  x = (x + (x >> 4)) & 0x0f0f0f0f0f0f0f0fU;
  x += x >> 8;
  x += x >> 16;
  x += x >> 32;
  sum += x & 0xffU;
}

/// Adds b and c to the bits a of the same weight, and returns the carries.
FUSIONSLAM_INLINE void add_carrying(Words& a, const Words& b, const Words& c, Words& carry) {
  const Words either = a ^ b;
  carry = (a & b) | (either & c);
  a = either ^ c;
}

/// Counts bits of blocks of eight vectors, most of them in adders of whole vectors (Harley, Seal;
/// Warren, Hacker's Delight, section 5-1).
struct BitSum {
  Words ones = {}, twos = {}, fours = {}, eights = {};

  FUSIONSLAM_INLINE void add(const Words* words) {
    Words two[4], four[2], eight;
    for (std::size_t i = 0; i < 4; ++i) add_carrying(ones, words[2 * i], words[2 * i + 1], two[i]);
    for (std::size_t i = 0; i < 2; ++i) add_carrying(twos, two[2 * i], two[2 * i + 1], four[i]);
    add_carrying(fours, four[0], four[1], eight);
    add_ones(eight, eights);
  }

  FUSIONSLAM_INLINE std::size_t count() const {
    Words sum = eights * 2;
    add_ones(fours, sum);
    sum *= 2;
    add_ones(twos, sum);
    sum *= 2;
    add_ones(ones, sum);
    return sum[0] + sum[1] + sum[2] + sum[3];
  }
};

FUSIONSLAM_INLINE BitCounts count_bits(const std::uint64_t* bits, const std::uint64_t* mask,
                                       const std::uint64_t* other_bits,
                                       const std::uint64_t* other_mask, std::size_t words) {
  BitSum valid, differing;
  for (std::size_t begin = 0; begin < words; begin += bit_block) {
    Words both[together], unequal[together];
    for (std::size_t i = 0; i < together; ++i) {
      const std::size_t at = begin + i * lanes;
      both[i] = load(mask + at) & load(other_mask + at);
      unequal[i] = (load(bits + at) ^ load(other_bits + at)) & both[i];
    }
    valid.add(both);
    differing.add(unequal);
  }
  return {valid.count(), differing.count()};
}

}  // namespace

CountBits bit_kernel(SimdLevel level) { return compiled_for<count_bits>(level); }

}  // namespace fusionslam::detail
