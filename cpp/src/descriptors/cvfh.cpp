// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Clustered Viewpoint Feature Histogram (Aldoma et al., ICCV Workshops 2011).
#include <algorithm>

#include "../detail/parallel.hpp"
#include "fusionslam/descriptors.hpp"
#include "smooth_regions.hpp"

namespace fusionslam {

std::vector<float> cvfh(PointsView points, const CvfhConfig& config, int threads) {
  validate(config);
  const detail::OrientedPoints cloud =
      detail::oriented_points(points, {}, config.leaf, config.normal_radius, threads, "CVFH");
  const detail::SmoothRegions smooth =
      detail::smooth_regions(cloud,
                             {config.leaf, config.normal_radius, config.min_points,
                              config.max_curvature, config.max_angle},
                             threads, "CVFH");
  const auto blocks = static_cast<std::size_t>(config.regions);
  std::vector<float> descriptor(blocks * detail::vfh_size);
  detail::parallel_for(std::min(blocks, smooth.regions.size()), threads, [&](std::size_t i) {
    const auto block =
        detail::vfh_histogram(cloud, detail::region_center(smooth.points, smooth.regions[i]));
    std::ranges::copy(block, descriptor.data() + i * detail::vfh_size);
  });
  return descriptor;
}

}  // namespace fusionslam
