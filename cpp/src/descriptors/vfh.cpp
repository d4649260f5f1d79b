// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Viewpoint Feature Histogram (Rusu, Bradski, Thibaux, Hsu, IROS 2010).
#include "fusionslam/descriptors.hpp"
#include "vfh_histogram.hpp"

namespace fusionslam {

std::vector<float> vfh(PointsView points, const VfhConfig& config, int threads) {
  validate(config);
  const detail::OrientedPoints cloud =
      detail::oriented_points(points, {}, config.leaf, config.normal_radius, threads, "VFH");
  const auto histogram = detail::vfh_histogram(cloud, detail::mean_center(cloud));
  return {histogram.begin(), histogram.end()};
}

}  // namespace fusionslam
