// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// PCL's point types and manners; files that use one of its algorithms include that themselves.
#pragma once

#include <pcl/console/print.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <mutex>

#include "fusionslam/sensors.hpp"

namespace fusionslam::detail {

inline pcl::PointCloud<pcl::PointXYZ>::Ptr pcl_cloud(PointsView points) {
  auto cloud = std::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  cloud->reserve(points.size);
  for (std::size_t i = 0; i < points.size; ++i)
    cloud->emplace_back(points[i][0], points[i][1], points[i][2]);
  return cloud;
}

/// Keeps PCL from printing while it lives: exceptions report problems here. PCL's level belongs to
/// the process, so the first of several at once lowers it and the last restores it.
class QuietPcl {
 public:
  QuietPcl() {
    const std::lock_guard lock(mutex_);
    if (alive_++ > 0) return;
    level_ = pcl::console::getVerbosityLevel();
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  }
  ~QuietPcl() {
    const std::lock_guard lock(mutex_);
    if (--alive_ == 0) pcl::console::setVerbosityLevel(level_);
  }
  QuietPcl(const QuietPcl&) = delete;
  QuietPcl& operator=(const QuietPcl&) = delete;

 private:
  static inline std::mutex mutex_;
  static inline int alive_ = 0;
  static inline pcl::console::VERBOSITY_LEVEL level_ = pcl::console::L_INFO;
};

}  // namespace fusionslam::detail
