// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <new>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "fusionslam/errors.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

inline std::string size_text(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

/// Throws DataError for an image beyond what OpenCV counts in: 16 bits a side in its maps, and an
/// int for the bytes of its colours.
inline void check_size_for_opencv(ImageView image) {
  constexpr int most = 32766;
  constexpr std::int64_t most_bytes = std::numeric_limits<int>::max();
  if (std::max(image.width, image.height) > most ||
      3 * static_cast<std::int64_t>(image.width) * image.height > most_bytes)
    throw DataError("an image of " + size_text(image.width, image.height) + ", expected up to " +
                    std::to_string(most) + " pixels a side and " + std::to_string(most_bytes / 3) +
                    " pixels");
}

/// Calls work(), which uses OpenCV, and turns OpenCV's own exceptions into ours.
template <class Work>
auto with_opencv(Work&& work) {
  try {
    return work();
  } catch (const cv::Exception& error) {
    if (error.code == cv::Error::StsNoMem) throw std::bad_alloc();
    throw DataError("OpenCV: " + error.err);
  }
}

/// View of an image; OpenCV does not write to it.
inline cv::Mat image_matrix(ImageView image) {
  return {image.height, image.width, image.channels == 3 ? CV_8UC3 : CV_8UC1,
          const_cast<std::uint8_t*>(image.data), image.row_stride};
}

/// Grey copy or view of an image; OpenCV does not write to it.
inline cv::Mat grey_image(ImageView image) {
  cv::Mat view = image_matrix(image);
  if (image.channels == 1) return view;
  cv::Mat grey;
  cv::cvtColor(view, grey, cv::COLOR_RGB2GRAY);
  return grey;
}

}  // namespace fusionslam::detail
