// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
/// OpenCV's brute-force matcher and stereo block matching, called directly.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace peers {

/// Threads of OpenCV in this process.
void set_opencv_threads(int threads);

/// Of each query row: the nearest of the rows and its L2 distance (cv::BFMatcher, NORM_L2).
std::pair<std::vector<std::int64_t>, std::vector<float>> opencv_nearest(const float* queries,
                                                                        std::size_t query_count,
                                                                        const float* rows,
                                                                        std::size_t row_count,
                                                                        std::size_t dimension);

/// cv::StereoBM with 64 disparities and windows of 21 pixels as image_undistort sets it up, then a
/// 5 x 5 median filter: disparities in 1/16 pixel, below zero where there is none.
std::vector<std::int16_t> opencv_disparity(const std::uint8_t* left, const std::uint8_t* right,
                                           int width, int height);

struct StereoGeometry {
  double focal, center_x, center_y, baseline, min_range, max_range;
};

/// The same, then cv::reprojectImageTo3D: the points within range (three values each), and their
/// grey values.
std::pair<std::vector<float>, std::vector<std::uint8_t>> opencv_stereo_cloud(
    const std::uint8_t* left, const std::uint8_t* right, int width, int height,
    const StereoGeometry& geometry);

const char* opencv_version();

}  // namespace peers
