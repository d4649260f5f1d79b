// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "projection_planes.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace fusionslam::detail {
namespace {

using std::numbers::pi;

/// Plane of normal (cos el cos az, cos el sin az, sin el): its x axis is (1, 0, 0) projected, not
/// normalised, its y axis the normal x that.
KernelPlane plane(double azimuth, double elevation) {
  const Eigen::Vector3d normal(std::cos(elevation) * std::cos(azimuth),
                               std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX() - normal[0] * normal;
  const Eigen::Vector3d y = normal.cross(x);
  return {{x[0], x[1], x[2]}, {y[0], y[1], y[2]}};
}

/// Step i of count from first to last, both included; a single step is the last.
double step(double first, double last, int i, int count) {
  return count == 1 ? last : first + (last - first) * i / (count - 1);
}

}  // namespace

std::vector<KernelPlane> grid_planes(int azimuths, int elevations) {
  std::vector<KernelPlane> planes;
  for (int i = 0; i < azimuths; ++i)
    for (int j = 0; j < elevations; ++j)
      planes.push_back(plane(step(-pi / 2, pi / 2, i, azimuths), step(0, pi / 2, j, elevations)));
  return planes;
}

std::vector<KernelPlane> mirrored_planes(int azimuths, int elevations) {
  std::vector<KernelPlane> planes;
  for (int i = 0; i < azimuths; ++i)
    for (int j = 0; j < elevations; ++j)
      planes.push_back(plane(-pi + 2 * pi * (i + 0.5) / azimuths, pi / 2 * (j + 0.5) / elevations));
  return planes;
}

}  // namespace fusionslam::detail
