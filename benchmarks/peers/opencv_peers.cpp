// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "opencv_peers.hpp"

#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/core/version.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

namespace peers {
namespace {

/// OpenCV has no view of constant data; nothing here writes to it.
template <class Value>
cv::Mat view(const Value* data, std::size_t rows, std::size_t columns) {
  return cv::Mat(static_cast<int>(rows), static_cast<int>(columns), cv::DataType<Value>::type,
                 const_cast<Value*>(data));
}

cv::Mat disparity(const std::uint8_t* left, const std::uint8_t* right, int width, int height) {
  const auto rows = static_cast<std::size_t>(height), columns = static_cast<std::size_t>(width);
  const auto matcher = cv::StereoBM::create(64, 21);
  matcher->setPreFilterType(cv::StereoBM::PREFILTER_XSOBEL);
  matcher->setPreFilterSize(9);
  matcher->setPreFilterCap(31);
  matcher->setTextureThreshold(10);
  matcher->setUniquenessRatio(15);
  matcher->setSpeckleRange(0);
  matcher->setSpeckleWindowSize(0);
  matcher->setMinDisparity(0);
  cv::Mat result;
  matcher->compute(view(left, rows, columns), view(right, rows, columns), result);
  cv::medianBlur(result, result, 5);
  return result;
}

}  // namespace

void set_opencv_threads(int threads) { cv::setNumThreads(threads); }

std::pair<std::vector<std::int64_t>, std::vector<float>> opencv_nearest(const float* queries,
                                                                        std::size_t query_count,
                                                                        const float* rows,
                                                                        std::size_t row_count,
                                                                        std::size_t dimension) {
  constexpr std::size_t block = std::size_t{1} << 17;  // a table may have 2^18 rows at most
  cv::BFMatcher matcher(cv::NORM_L2);
  for (std::size_t begin = 0; begin < row_count; begin += block)
    matcher.add(std::vector<cv::Mat>{
        view(rows + begin * dimension, std::min(block, row_count - begin), dimension)});
  std::vector<cv::DMatch> matches;
  matcher.match(view(queries, query_count, dimension), matches);
  std::pair<std::vector<std::int64_t>, std::vector<float>> result;
  for (const cv::DMatch& match : matches) {
    result.first.push_back(static_cast<std::int64_t>(block) * match.imgIdx + match.trainIdx);
    result.second.push_back(match.distance);
  }
  return result;
}

std::vector<std::int16_t> opencv_disparity(const std::uint8_t* left, const std::uint8_t* right,
                                           int width, int height) {
  const cv::Mat found = disparity(left, right, width, height);
  return {found.begin<std::int16_t>(), found.end<std::int16_t>()};
}

std::pair<std::vector<float>, std::vector<std::uint8_t>> opencv_stereo_cloud(
    const std::uint8_t* left, const std::uint8_t* right, int width, int height,
    const StereoGeometry& geometry) {
  cv::Mat found;
  disparity(left, right, width, height).convertTo(found, CV_32F, 1.0 / 16);
  const cv::Matx44d q(1, 0, 0, -geometry.center_x, 0, 1, 0, -geometry.center_y, 0, 0, 0,
                      geometry.focal, 0, 0, 1 / geometry.baseline, 0);
  cv::Mat points;
  cv::reprojectImageTo3D(found, points, q);
  std::pair<std::vector<float>, std::vector<std::uint8_t>> cloud;
  for (int row = 0; row < height; ++row)
    for (int column = 0; column < width; ++column) {
      const auto& p = points.at<cv::Vec3f>(row, column);
      if (!(found.at<float>(row, column) > 0)) continue;
      if (!(p[2] >= geometry.min_range && p[2] <= geometry.max_range)) continue;
      cloud.first.insert(cloud.first.end(), {p[0], p[1], p[2]});
      cloud.second.push_back(left[static_cast<std::size_t>(row) * static_cast<std::size_t>(width) +
                                  static_cast<std::size_t>(column)]);
    }
  return cloud;
}

const char* opencv_version() { return CV_VERSION; }

}  // namespace peers
