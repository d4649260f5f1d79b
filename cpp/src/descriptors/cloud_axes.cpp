// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "cloud_axes.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "fusionslam/errors.hpp"
#include "moments_kernel.hpp"

namespace fusionslam::detail {
namespace {

constexpr double float_rounding = 1e-13;  ///< square of float's relative rounding, with some margin

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
  const double first = variances[2];
  const double second = variances[1];
  const double scale = mean.squaredNorm() + first;
  if (!(first > float_rounding * scale))
    throw DataError("all points of the cloud are equal: it has no principal axes");
  if (!(second > float_rounding * scale))
    throw DataError("all points of the cloud lie on one line: its principal axes are undefined");
}

/// MATLAB's pca: the entry of largest magnitude of each axis is positive.
OwnFrame matlab_axes(PointsView points) {
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
OwnFrame pcl_axes(PointsView points, double mean_square) {
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

/// Density of points over azimuth, as a sum of its first harmonics.
class AzimuthDensity {
 public:
  AzimuthDensity(PointsView points, const Eigen::Vector3d& mean) {
    for_each_chunk(points, [&](RawPoints chunk) {
      for (std::size_t i = 0; i < chunk.size; ++i) add(chunk.data + i * chunk.stride, mean);
    });
    for (std::size_t k = 0; k < harmonics_.size(); ++k) {
      const double turns = static_cast<double>(k + 1) * smoothing;
      harmonics_[k] *= std::exp(-turns * turns / 2);
    }
  }

  /// Its highest maximum, radians. All are looked at between the steps of a search, so that the
  /// result turns with the cloud.
  double densest() const {
    constexpr int steps = 256;
    const auto at = [](int i) { return 2 * std::numbers::pi * i / steps; };
    double best = 0, highest = -std::numeric_limits<double>::infinity();
    for (int i = 0; i < steps; ++i) {
      const double density = value(at(i));
      if (value(at(i - 1)) > density || value(at(i + 1)) > density) continue;
      const double peak = climb(at(i), at(1));
      if (value(peak) <= highest) continue;
      best = peak;
      highest = value(peak);
    }
    return best;
  }

 private:
  static constexpr double smoothing = 0.5;  ///< rad, standard deviation

  void add(const float* point, const Eigen::Vector3d& mean) {
    const std::complex<double> offset(point[0] - mean[0], point[1] - mean[1]);
    const double distance = std::abs(offset);
    if (distance == 0) return;
    const std::complex<double> turn = std::conj(offset) / distance;
    std::complex<double> weighted = distance * distance * distance;
    for (std::complex<double>& harmonic : harmonics_) harmonic += weighted *= turn;
  }

  /// The density at an azimuth, or a derivative of it.
  double value(double azimuth, int derivative = 0) const {
    double sum = 0;
    for (std::size_t k = 0; k < harmonics_.size(); ++k) {
      const auto turns = static_cast<double>(k + 1);
      const std::complex<double> wave = std::polar(
          std::pow(turns, derivative), turns * azimuth + derivative * std::numbers::pi / 2);
      sum += (harmonics_[k] * wave).real();
    }
    return sum;
  }

  /// The maximum within a step of where a search passed it, by Newton's method.
  double climb(double azimuth, double step) const {
    const double begin = azimuth;
    for (int i = 0; i < 20; ++i) {
      const double curvature = value(azimuth, 2);
      if (!(curvature < 0)) break;
      azimuth = std::clamp(azimuth - value(azimuth, 1) / curvature, begin - step, begin + step);
    }
    return azimuth;
  }

  std::array<std::complex<double>, 4> harmonics_{};
};

}  // namespace

OwnFrame principal_axes(PointsView points, AxisSigns signs) {
  const OwnFrame precise = matlab_axes(points);  // refuses clouds without axes, for both
  return signs == AxisSigns::pcl ? pcl_axes(points, precise.mean_square) : precise;
}

OwnFrame upright_axes(PointsView points) {
  const MomentsKernel kernel = moments_kernel(simd_level());
  const Eigen::Vector3d mean = mean_point(points, kernel);
  const Eigen::Matrix3d spread = covariance(points, mean, kernel);
  if (!(spread(0, 0) + spread(1, 1) > float_rounding * (mean.squaredNorm() + spread.trace())))
    throw DataError("all points of the cloud lie on one vertical line: no azimuth is the densest");
  const double azimuth = AzimuthDensity(points, mean).densest();
  const double c = std::cos(azimuth), s = std::sin(azimuth);
  Eigen::Matrix3d axes;
  axes << c, s, 0, -s, c, 0, 0, 0, 1;
  return {mean, axes, spread.trace()};
}

}  // namespace fusionslam::detail
