// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "fusionslam/config.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/errors.hpp"
#include "fusionslam/experience_map.hpp"
#include "fusionslam/fusion.hpp"
#include "fusionslam/interrupt.hpp"
#include "fusionslam/matching.hpp"
#include "fusionslam/pose_cells.hpp"
#include "fusionslam/range_image.hpp"
#include "fusionslam/sensors.hpp"
#include "fusionslam/simd.hpp"
#include "fusionslam/view_alignment.hpp"
#include "fusionslam/view_similarity.hpp"
#include "fusionslam/views.hpp"
