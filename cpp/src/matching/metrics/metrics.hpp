// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The metrics, one factory each. All throw ShapeError if a row may not have this length.
#pragma once

#include "row_metric.hpp"

namespace fusionslam::detail {

using MetricPointer = std::unique_ptr<const RowMetric>;

MetricPointer scan_context_metric(std::size_t dimension);
MetricPointer l1_metric(std::size_t dimension);
MetricPointer chi_square_metric(std::size_t dimension);
MetricPointer regions_metric(std::size_t dimension);
MetricPointer nearest_of_set_metric(std::size_t dimension);
MetricPointer votes_metric(std::size_t dimension);
MetricPointer aligned_polar_metric(std::size_t dimension);
MetricPointer aligned_cartesian_metric(std::size_t dimension);
MetricPointer intensity_scan_context_metric(std::size_t dimension);
MetricPointer iris_metric(std::size_t dimension);
MetricPointer ring_metric(std::size_t dimension);

}  // namespace fusionslam::detail
