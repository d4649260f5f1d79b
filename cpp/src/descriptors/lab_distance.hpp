// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace fusionslam::detail {

/// The colour metric of CSHOT (Tombari, Salti, Di Stefano 2011): city-block distance in CIE L*a*b*
/// from one colour, scaled so that black and white are a third apart.
class LabDistance {
 public:
  explicit LabDistance(std::array<std::uint8_t, 3> from) : from_(lab(from)) {}

  float operator()(std::array<std::uint8_t, 3> color) const;

 private:
  static std::array<float, 3> lab(std::array<std::uint8_t, 3> rgb);

  std::array<float, 3> from_;
};

}  // namespace fusionslam::detail
