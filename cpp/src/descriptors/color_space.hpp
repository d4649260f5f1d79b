// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "fusionslam/descriptors.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

/// Histogram bin of each channel of each colour, three bytes a colour
/// (c-M2DP author's binning: floor(value / width) with a width just above range / bins).
std::vector<std::uint8_t> color_bins(ColorsView colors, ColorSpace space, const M2dpConfig& config);

/// Channels in [0, 1]: (hue / 360, saturation, value).
std::array<double, 3> hsv_from_rgb(std::uint8_t r, std::uint8_t g, std::uint8_t b);

/// (L / 100, (a + 128) / 255, (b + 128) / 255) with white D65. With `author_fault` the choice
/// between the two branches of the sRGB curve is made by the linear red value for green and blue.
std::array<double, 3> lab_from_rgb(std::uint8_t r, std::uint8_t g, std::uint8_t b,
                                   bool author_fault);

}  // namespace fusionslam::detail
