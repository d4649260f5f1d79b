// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "m2dp_kernel.hpp"

namespace fusionslam::detail {

/// The planes of He's program: azimuths from -90 to 90 degrees, each with elevations from 0 to 90
/// degrees, end points included. The azimuth is the outer loop.
std::vector<KernelPlane> grid_planes(int azimuths, int elevations);

/// Planes that mirroring any of the three axes maps onto one another: azimuths evenly round the
/// circle, elevations evenly above the horizon, no plane on an axis. The azimuth is the outer loop.
std::vector<KernelPlane> mirrored_planes(int azimuths, int elevations);

}  // namespace fusionslam::detail
