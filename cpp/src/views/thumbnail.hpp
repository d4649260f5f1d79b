// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// A view in a few bytes, to find the stored ones that may be the same place.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "fusionslam/views/range_image.hpp"

namespace fusionslam::detail {

/// For each column of 6 degrees, and below, at and above the horizon: mean inverse range, share of
/// the cells that have points, and mean colour.
struct Thumbnail {
  static constexpr int circle = 60;  ///< columns around
  static constexpr int bands = 3;
  using Column = std::array<std::array<std::uint8_t, 5>, bands>;

  int first = 0;  ///< column of the first one in view
  std::vector<Column> columns;
};

Thumbnail thumbnail_of(const RangeImage& image);

/// Difference of two thumbnails, the least over turns of up to 18 degrees; 0 to about 3.
float thumbnail_distance(const Thumbnail& a, const Thumbnail& b);

}  // namespace fusionslam::detail
