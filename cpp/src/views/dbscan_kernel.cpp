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

}  // namespace

CountWithin* count_within(int dimensions, SimdLevel level) {
  return dimensions == 3 ? compiled_for<count<3>>(level) : compiled_for<count<6>>(level);
}

}  // namespace fusionslam::detail
