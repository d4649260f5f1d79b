// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// How a kernel is compiled for several instruction sets and chosen at run time.
//
// A kernel file writes its loop once as a FUSIONSLAM_INLINE function over plain pointers, wraps it
// in one function a level (FUSIONSLAM_AVX2, FUSIONSLAM_AVX512 in front of it), into which it is
// inlined and vectorised for that level, and picks one with choose(). Without fused multiply-adds
// (-ffp-contract=off) and with sums in a fixed number of lanes all levels give the same bits.
// Kernel files see no PCL, Eigen or OpenCV. The one exception is matching/distance_kernel.cpp,
// whose filter may round as each level likes, because what passes it is measured again.
#pragma once

#include "fusionslam/simd.hpp"

#define FUSIONSLAM_INLINE [[gnu::always_inline]] inline

#if defined(__x86_64__)
#define FUSIONSLAM_AVX2 __attribute__((target("avx2,bmi,bmi2,lzcnt,popcnt")))
#define FUSIONSLAM_AVX512                  \
  __attribute__((                          \
      target("avx2,bmi,bmi2,lzcnt,popcnt," \
             "avx512f,avx512bw,avx512dq,avx512vl,prefer-vector-width=512")))
#else  // other machines never get past the baseline
#define FUSIONSLAM_AVX2
#define FUSIONSLAM_AVX512
#endif

namespace fusionslam::detail {

/// The variant for a level that simd_level() or best_simd_level() allows.
template <class Function>
Function* choose(SimdLevel level, Function* baseline, Function* avx2, Function* avx512) {
  return level == SimdLevel::avx512 ? avx512 : level == SimdLevel::avx2 ? avx2 : baseline;
}

}  // namespace fusionslam::detail
