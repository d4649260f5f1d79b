// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

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
