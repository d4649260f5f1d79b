// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "dbscan_kernel.hpp"

#include <cstdint>

#include "../detail/simd.hpp"

namespace fusionslam::detail {
namespace {

template <int D>
FUSIONSLAM_INLINE std::size_t count(const double* columns, std::size_t stride, std::size_t size,
                                    const double* query, double bound) {
  std::int64_t found = 0;
  for (std::size_t i = 0; i < size; ++i) {
    double squares = 0;
    for (int d = 0; d < D; ++d) {
      const double difference = columns[static_cast<std::size_t>(d) * stride + i] - query[d];
      squares += difference * difference;
    }
    found += squares <= bound ? 1 : 0;
  }
  return static_cast<std::size_t>(found);
}

template <int D>
std::size_t count_baseline(const double* columns, std::size_t stride, std::size_t size,
                           const double* query, double bound) {
  return count<D>(columns, stride, size, query, bound);
}
template <int D>
FUSIONSLAM_AVX2 std::size_t count_avx2(const double* columns, std::size_t stride, std::size_t size,
                                       const double* query, double bound) {
  return count<D>(columns, stride, size, query, bound);
}
template <int D>
FUSIONSLAM_AVX512 std::size_t count_avx512(const double* columns, std::size_t stride,
                                           std::size_t size, const double* query, double bound) {
  return count<D>(columns, stride, size, query, bound);
}

}  // namespace

CountWithin* count_within(int dimensions, SimdLevel level) {
  if (dimensions == 3)
    return choose<CountWithin>(level, count_baseline<3>, count_avx2<3>, count_avx512<3>);
  return choose<CountWithin>(level, count_baseline<6>, count_avx2<6>, count_avx512<6>);
}

}  // namespace fusionslam::detail
