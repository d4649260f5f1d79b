// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "fusionslam/views/alignment.hpp"
#include "prepared_view.hpp"

namespace fusionslam::detail {

/// Aligns two views whose thumbnails differ by `thumbnail`.
Alignment align_views(const PreparedView& current, const PreparedView& stored, float thumbnail,
                      const AlignmentConfig& config);

/// The probability that follows from the evidence (a logistic function of its squares, fitted by
/// benchmarks/accuracy/alignment.py).
double probability_of(const AlignmentEvidence& evidence);

}  // namespace fusionslam::detail
