// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// How a kernel is compiled for several instruction sets and chosen at run time.
//
// A kernel file writes its loop once, as a FUSIONSLAM_INLINE function over plain pointers, and asks
// for compiled_for<loop>(level): the loop is inlined into one function a level and vectorised
// there. Where a level has a loop of its own, choose() picks among the three. Without fused
// multiply-adds (-ffp-contract=off) and with sums in a fixed number of lanes all levels give the
// same bits.
// Kernel files see no PCL, Eigen or OpenCV. The one exception is matching/distance_kernel.cpp,
// whose filter may round as each level likes, because what passes it is measured again.
#pragma once

#include "fusionslam/simd.hpp"

#define FUSIONSLAM_INLINE [[gnu::always_inline]] inline

#if defined(__clang__)  // ignores the whole attribute where it does not know one part of it
#define FUSIONSLAM_WIDE_VECTORS ""
#else
#define FUSIONSLAM_WIDE_VECTORS ",prefer-vector-width=512"
#endif

#if defined(__x86_64__)
#define FUSIONSLAM_AVX2 __attribute__((target("avx2,bmi,bmi2,lzcnt,popcnt")))
#define FUSIONSLAM_AVX512                  \
  __attribute__((                          \
      target("avx2,bmi,bmi2,lzcnt,popcnt," \
             "avx512f,avx512bw,avx512dq,avx512vl" FUSIONSLAM_WIDE_VECTORS)))
#else  // other machines never get past the baseline
#define FUSIONSLAM_AVX2
#define FUSIONSLAM_AVX512
#endif

namespace fusionslam::detail {

/// The function for a level that simd_level() or best_simd_level() allows.
template <class Function>
Function* choose(SimdLevel level, Function* baseline, Function* avx2, Function* avx512) {
  return level == SimdLevel::avx512 ? avx512 : level == SimdLevel::avx2 ? avx2 : baseline;
}

template <auto* loop>
struct Levels;

/// One function a level, each with its own copy of the loop.
template <class Result, class... Arguments, Result (*loop)(Arguments...)>
struct Levels<loop> {
  static Result baseline(Arguments... arguments) { return loop(arguments...); }
  FUSIONSLAM_AVX2 static Result avx2(Arguments... arguments) { return loop(arguments...); }
  FUSIONSLAM_AVX512 static Result avx512(Arguments... arguments) { return loop(arguments...); }
};

/// The copy of the loop for a level that simd_level() or best_simd_level() allows.
template <auto* loop>
auto* compiled_for(SimdLevel level) {
  using Copies = Levels<loop>;
  return choose(level, Copies::baseline, Copies::avx2, Copies::avx512);
}

}  // namespace fusionslam::detail
