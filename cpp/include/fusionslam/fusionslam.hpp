// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "fusionslam/config.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/errors.hpp"
#include "fusionslam/fusion.hpp"
#include "fusionslam/interrupt.hpp"
#include "fusionslam/mapping.hpp"
#include "fusionslam/matching.hpp"
#include "fusionslam/ratslam/experience_map.hpp"
#include "fusionslam/ratslam/pose_cells.hpp"
#include "fusionslam/registration.hpp"
#include "fusionslam/sensors.hpp"
#include "fusionslam/simd.hpp"
#include "fusionslam/views/alignment.hpp"
#include "fusionslam/views/range_image.hpp"
#include "fusionslam/views/scene.hpp"
#include "fusionslam/views/similarity.hpp"
