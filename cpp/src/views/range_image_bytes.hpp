// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "bit_stream.hpp"
#include "fusionslam/views/range_image.hpp"

namespace fusionslam::detail {

/// The image, exactly: which cells of its box are filled, then ranges and colours as differences
/// from the cell before.
Bytes image_to_bytes(const RangeImage& image);

/// Throws DataError if these are no such bytes.
RangeImage image_from_bytes(std::span<const std::uint8_t> bytes);

}  // namespace fusionslam::detail
