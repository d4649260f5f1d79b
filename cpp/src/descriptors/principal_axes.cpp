// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "principal_axes.hpp"

#include <Eigen/Eigenvalues>

#include "fusionslam/errors.hpp"

namespace fusionslam::detail {
namespace {

template <class Scalar>
using Vector3 = Eigen::Matrix<Scalar, 3, 1>;
template <class Scalar>
using Matrix3 = Eigen::Matrix<Scalar, 3, 3>;

template <class Scalar>
Vector3<Scalar> point(PointsView points, std::size_t i) {
  const float* p = points[i];
  return {Scalar(p[0]), Scalar(p[1]), Scalar(p[2])};
}

template <class Scalar>
Vector3<Scalar> mean_point(PointsView points) {
  Vector3<Scalar> sum = Vector3<Scalar>::Zero();
  for (std::size_t i = 0; i < points.size; ++i) sum += point<Scalar>(points, i);
  return sum / Scalar(points.size);
}

template <class Scalar>
Matrix3<Scalar> scatter(PointsView points, const Vector3<Scalar>& mean) {
  Matrix3<Scalar> sum = Matrix3<Scalar>::Zero();
  for (std::size_t i = 0; i < points.size; ++i) {
    const Vector3<Scalar> p = point<Scalar>(points, i) - mean;
    sum += p * p.transpose();
  }
  return sum / Scalar(points.size);
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
  const Eigen::Vector3d mean = mean_point<double>(points);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter<double>(points, mean));
  check_spread(solver.eigenvalues(), mean);
  Eigen::Matrix3d axes;
  for (int i = 0; i < 3; ++i) {
    Eigen::Vector3d axis = solver.eigenvectors().col(2 - i);
    Eigen::Index largest = 0;
    axis.cwiseAbs().maxCoeff(&largest);
    axes.row(i) = axis[largest] < 0 ? -axis : axis;
  }
  return {mean, axes};
}

/// PCL's PCA: float throughout, signs as the solver leaves them, a right-handed frame.
PrincipalAxes pcl_axes(PointsView points) {
  const Eigen::Vector3f mean = mean_point<float>(points);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> solver(scatter<float>(points, mean));
  Eigen::Matrix3f axes;
  axes.row(0) = solver.eigenvectors().col(2);
  axes.row(1) = solver.eigenvectors().col(1);
  axes.row(2) = axes.row(0).cross(axes.row(1));
  return {mean.cast<double>(), axes.cast<double>()};
}

}  // namespace

PrincipalAxes principal_axes(PointsView points, AxisSigns signs) {
  const PrincipalAxes precise = matlab_axes(points);  // refuses clouds without axes, for both
  return signs == AxisSigns::pcl ? pcl_axes(points) : precise;
}

}  // namespace fusionslam::detail
