// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#if defined(__x86_64__)
#include <cpuid.h>
#endif

#include <cstdlib>

#include "simd.hpp"

namespace fusionslam {
namespace {

SimdLevel level_in_use() {
  const char* wanted = std::getenv("FUSIONSLAM_SIMD");
  if (wanted == nullptr || *wanted == '\0') return best_simd_level();
  const auto level = choice_from_name<SimdLevel>("FUSIONSLAM_SIMD", wanted);
  if (level > best_simd_level())
    throw ConfigError("FUSIONSLAM_SIMD is '" + std::string(wanted) +
                      "', this machine has no more than " +
                      std::string(choice_name(best_simd_level())));
  return level;
}

#if defined(__x86_64__)
/// Clang 16 does not know the builtin's name of this feature.
bool counts_zeros() {
  unsigned a = 0, b = 0, c = 0, d = 0;
  return __get_cpuid(0x80000001, &a, &b, &c, &d) && (c & bit_LZCNT);
}
#endif

}  // namespace

SimdLevel best_simd_level() {
#if defined(__x86_64__)
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("bmi") ||
      !__builtin_cpu_supports("bmi2") || !__builtin_cpu_supports("popcnt") || !counts_zeros())
    return SimdLevel::baseline;
  const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  return avx512 ? SimdLevel::avx512 : SimdLevel::avx2;
#else
  return SimdLevel::baseline;
#endif
}

SimdLevel simd_level() {
  static const SimdLevel level = level_in_use();  // a throw leaves it to be tried again
  return level;
}

}  // namespace fusionslam
