// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
/// The Point Cloud Library's own classes, used as its documentation says.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace peers {

/// Clouds in PCL's types, made before anything is timed.
class PclCloud {
 public:
  struct Data;

  /// `xyz` and `rgb` hold three values a point; `rgb` may be null.
  PclCloud(const float* xyz, const std::uint8_t* rgb, std::size_t size);

  const Data& data() const { return *data_; }

 private:
  std::shared_ptr<const Data> data_;
};

/// A cloud whose points all have a normal.
class PclSurface {
 public:
  struct Data;

  /// NormalEstimation, or NormalEstimationOMP for more than one thread, over neighbours within
  /// `radius`; points without a normal are removed.
  PclSurface(const PclCloud& cloud, double radius, int threads);

  const Data& data() const { return *data_; }
  std::vector<float> normals() const;  ///< three a point
  std::vector<std::int64_t> indices() const;

 private:
  std::shared_ptr<const Data> data_;
};

/// SHOTEstimation and SHOTColorEstimation of one keypoint, the mean point (its colour the mean
/// colour), with the whole surface as its support.
std::vector<float> pcl_shot(const PclSurface& surface);
std::vector<float> pcl_cshot(const PclSurface& surface);

struct ColoredPoints {
  std::vector<float> xyz;
  std::vector<std::uint8_t> rgb;
};

/// Projects a cloud into an RGB image with PCL's and Eigen's types: the points in front of the
/// camera whose nearest pixel is inside, with its colour. Returns how many there are; `result`
/// receives them if it is not null. `projection` is 3x4, row-major.
std::size_t pcl_colorize(const PclCloud& cloud, const std::uint8_t* image, int width, int height,
                         const std::array<double, 12>& projection, ColoredPoints* result);

const char* pcl_version();

}  // namespace peers
