// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace fusionslam::detail {

/// Factors of red, green and blue.
using Gains = std::array<double, 3>;

/// Colours of points that two cameras see, and the gains that make them alike.
class Exposures {
 public:
  explicit Exposures(std::size_t cameras);

  /// Notes a point's colours in two cameras, the first of which has the smaller number.
  void add(std::size_t first, const std::array<std::uint8_t, 3>& first_color, std::size_t second,
           const std::array<std::uint8_t, 3>& second_color);

  /// The gains of each camera (colorize_all_round says which). The same samples give the same bits
  /// on any machine.
  std::vector<Gains> gains();

 private:
  /// Logarithms of the ratio of the first camera's values to the second's, by channel.
  using Ratios = std::array<std::vector<std::int32_t>, 3>;

  Ratios& between(std::size_t first, std::size_t second) {
    return ratios_[second * (second - 1) / 2 + first];
  }
  std::vector<double> solve(std::size_t channel);

  std::size_t cameras_;
  std::vector<Ratios> ratios_;
};

}  // namespace fusionslam::detail
