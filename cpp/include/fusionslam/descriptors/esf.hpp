// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Ensemble of Shape Functions (640 floats that sum to 1; Wohlkinger, Vincze, ROBIO 2011), with
/// PCL's weights: of 20,000 triangles of points, of the cloud scaled to a sphere of 32 voxels about
/// its centroid, ten histograms of 64 bins: angles, square roots of areas and lengths of sides,
/// each for lines that lie on the surface, off it and on both, then the share of the surface in the
/// latter. The triangles are drawn by a generator with a fixed seed, so that a cloud has one ESF,
/// and the same points in another order have one that differs by the error of sampling. It does not
/// depend on scale and shifts; turns change it as far as the voxels change. Throws DataError for
/// NaN or infinity, fewer than 3 points, and clouds with hardly a triangle, such as lines.
std::vector<float> esf(PointsView points);

}  // namespace fusionslam
