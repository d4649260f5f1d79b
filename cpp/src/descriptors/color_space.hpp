// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "fusionslam/descriptors.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

/// For each channel what replaces each of its values.
using ByteTable = std::array<std::array<std::uint8_t, 256>, 3>;

/// Brings the mean of each channel to the same value (the grey-world assumption of Buchsbaum
/// 1980), which cancels exposure and tint.
ByteTable grey_world(ColorsView colors);

/// Histogram bins of the colours of a cloud (c-M2DP author's binning: floor(value / width) with a
/// width just above range / bins), after scaling to a grey world if that is configured.
class ColorBinner {
 public:
  ColorBinner(ColorsView colors, ColorSpace space, const M2dpConfig& config);

  /// Three bins a colour, for `count` colours from `begin` on.
  void bins(std::size_t begin, std::size_t count, std::uint8_t* result) const;

 private:
  ColorsView colors_;
  ColorSpace space_;
  M2dpConfig config_;
  ByteTable scaled_;                                       ///< channel values times their gains
  std::array<std::array<std::uint8_t, 256>, 3> rgb_bins_;  ///< and the bins of these
};

/// Channels in [0, 1]: (hue / 360, saturation, value).
std::array<double, 3> hsv_from_rgb(std::uint8_t r, std::uint8_t g, std::uint8_t b);

/// (L / 100, (a + 128) / 255, (b + 128) / 255) with white D65. With `author_fault` the choice
/// between the two branches of the sRGB curve is made by the linear red value for green and blue.
std::array<double, 3> lab_from_rgb(std::uint8_t r, std::uint8_t g, std::uint8_t b,
                                   bool author_fault);

/// (L, a, b) of CIE 1976 with white D65, of channels from 0 to 255 between the bytes, too.
std::array<double, 3> lab_from_rgb(const std::array<double, 3>& rgb);

}  // namespace fusionslam::detail
