// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "principal_axes.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "fusionslam/errors.hpp"
#include "moments_kernel.hpp"

namespace fusionslam::detail {
namespace {

/// Calls work(chunk) for consecutive parts of the cloud, in order.
template <class Work>
void for_each_chunk(PointsView points, Work&& work) {
  constexpr std::size_t chunk = 1 << 16;
  for (std::size_t begin = 0; begin < points.size; begin += chunk) {
    check_interrupt();
    work(RawPoints{points[begin], points.stride, std::min(chunk, points.size - begin)});
  }
}

Eigen::Vector3d mean_point(PointsView points, const MomentsKernel& kernel) {
  double sums[3] = {};
  for_each_chunk(points, [&](RawPoints chunk) { kernel.sum(chunk, sums); });
  // Finite floats cannot overflow a double, so one look at the sums checks all points.
  const Eigen::Vector3d sum(sums[0], sums[1], sums[2]);
  if (!sum.allFinite()) check_points(points, 0, "the mean");
  return sum / static_cast<double>(points.size);
}

/// Second moments about the mean, divided by the number of points.
Eigen::Matrix3d covariance(PointsView points, const Eigen::Vector3d& mean,
                           const MomentsKernel& kernel) {
  double sums[6] = {};
  for_each_chunk(points, [&](RawPoints chunk) { kernel.scatter(chunk, mean.data(), sums); });
  Eigen::Matrix3d result;
  result << sums[0], sums[3], sums[4], sums[3], sums[1], sums[5], sums[4], sums[5], sums[2];
  return result / static_cast<double>(points.size);
}

/// Two axes are only defined if the points spread, beyond the rounding of float, along both.
void check_spread(const Eigen::Vector3d& variances, const Eigen::Vector3d& mean) {
  const double float_rounding = 1e-13;  // square of float's relative rounding, with some margin
  const double first = variances[2];
  const double second = variances[1];
  const double scale = mean.squaredNorm() + first;
  if (!(first > float_rounding * scale))
    throw DataError("all points of the cloud are equal: it has no principal axes");
  if (!(second > float_rounding * scale))
    throw DataError("all points of the cloud lie on one line: its principal axes are undefined");
}

/// MATLAB's pca: the entry of largest magnitude of each axis is positive.
PrincipalAxes matlab_axes(PointsView points) {
  const MomentsKernel kernel = moments_kernel(simd_level());
  const Eigen::Vector3d mean = mean_point(points, kernel);
  const Eigen::Matrix3d spread = covariance(points, mean, kernel);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(spread);
  check_spread(solver.eigenvalues(), mean);
  Eigen::Matrix3d axes;
  for (int i = 0; i < 3; ++i) {
    Eigen::Vector3d axis = solver.eigenvectors().col(2 - i);
    Eigen::Index largest = 0;
    axis.cwiseAbs().maxCoeff(&largest);
    axes.row(i) = axis[largest] < 0 ? -axis : axis;
  }
  return {mean, axes, spread.trace()};
}

/// PCL's PCA: float throughout and one point after the other, signs as the solver leaves them, a
/// right-handed frame.
PrincipalAxes pcl_axes(PointsView points, double mean_square) {
  Eigen::Vector3f mean = Eigen::Vector3f::Zero();
  for (std::size_t i = 0; i < points.size; ++i)
    mean += Eigen::Map<const Eigen::Vector3f>(points[i]);
  mean /= static_cast<float>(points.size);
  Eigen::Matrix3f scatter = Eigen::Matrix3f::Zero();
  for (std::size_t i = 0; i < points.size; ++i) {
    const Eigen::Vector3f p = Eigen::Map<const Eigen::Vector3f>(points[i]) - mean;
    scatter += p * p.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> solver(scatter /
                                                              static_cast<float>(points.size));
  Eigen::Matrix3f axes;
  axes.row(0) = solver.eigenvectors().col(2);
  axes.row(1) = solver.eigenvectors().col(1);
  axes.row(2) = axes.row(0).cross(axes.row(1));
  return {mean.cast<double>(), axes.cast<double>(), mean_square};
}

}  // namespace

PrincipalAxes principal_axes(PointsView points, AxisSigns signs) {
  const PrincipalAxes precise = matlab_axes(points);  // refuses clouds without axes, for both
  return signs == AxisSigns::pcl ? pcl_axes(points, precise.mean_square) : precise;
}

}  // namespace fusionslam::detail
