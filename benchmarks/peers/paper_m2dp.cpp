// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "paper_m2dp.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace paper {
namespace {

using std::numbers::pi;

/// Rows are the principal axes, longest first.
Eigen::Matrix3d principal_axes(const Points& centered) {
  const Eigen::Matrix3d covariance =
      centered * centered.transpose() / static_cast<double>(centered.cols());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  Eigen::Matrix3d axes = solver.eigenvectors().transpose().colwise().reverse();
  for (int i = 0; i < 3; ++i) {
    Eigen::Index largest = 0;
    axes.row(i).cwiseAbs().maxCoeff(&largest);
    if (axes(i, largest) < 0) axes.row(i) *= -1;
  }
  return axes;
}

/// Distance to the nearest whole number among first .. last.
double to_nearest(double value, int first, int last) {
  return std::fabs(value - std::clamp<double>(std::round(value), first, last));
}

}  // namespace

PlaneAxes plane_axes(int plane) {
  const double azimuth = -pi / 2 + pi * (plane / elevations) / (azimuths - 1);
  const double elevation = pi / 2 * (plane % elevations) / (elevations - 1);
  const Eigen::Vector3d normal(std::cos(elevation) * std::cos(azimuth),
                               std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX() - normal[0] * normal;
  PlaneAxes axes;
  axes << x.transpose(), normal.cross(x).transpose();
  return axes;
}

int Place::ring_bin() const { return std::min(static_cast<int>(std::floor(ring)), circles - 1); }

int Place::sector_bin() const {
  return std::min(static_cast<int>(std::floor(sector)), sectors - 1);
}

double Place::edge_distance() const {
  // The middle and the outermost circle part no two bins, but at -pi and pi two sectors meet.
  return std::min(to_nearest(ring, 1, circles - 1), to_nearest(sector, 0, sectors));
}

AlignedCloud::AlignedCloud(const Points& points) {
  const Points centered = points.colwise() - points.rowwise().mean();
  points_ = principal_axes(centered) * centered;
  sqrt_rho_max_ = std::sqrt(points_.colwise().norm().maxCoeff());
}

Place AlignedCloud::place(const PlaneAxes& axes, Eigen::Index point) const {
  const Eigen::Vector2d projected = axes * points_.col(point);
  const double rho = std::sqrt(projected.squaredNorm());
  const double theta = std::atan2(projected.y(), projected.x());
  // Circle i has radius (i sqrt(rho_max) / l)^2.
  return {std::sqrt(rho) / sqrt_rho_max_ * circles, (theta + pi) / (2 * pi) * sectors};
}

Eigen::MatrixXd m2dp_signature(const AlignedCloud& cloud) {
  Eigen::MatrixXd signature = Eigen::MatrixXd::Zero(planes, shape_columns);
  for (int plane = 0; plane < planes; ++plane) {
    const PlaneAxes axes = plane_axes(plane);
    for (Eigen::Index i = 0; i < cloud.size(); ++i) {
      const Place place = cloud.place(axes, i);
      signature(plane, place.ring_bin() * sectors + place.sector_bin()) += 1;
    }
  }
  return signature / static_cast<double>(cloud.size());
}

Eigen::MatrixXd cm2dp_signature(const AlignedCloud& cloud, const Colors& colors) {
  constexpr double bin_width = 255.0 / color_bins + 0.001;
  Eigen::MatrixXd signature = Eigen::MatrixXd::Zero(planes, shape_columns + color_columns);
  for (int plane = 0; plane < planes; ++plane) {
    const PlaneAxes axes = plane_axes(plane);
    for (Eigen::Index i = 0; i < cloud.size(); ++i) {
      const Place place = cloud.place(axes, i);
      const int ring = place.ring_bin();
      signature(plane, ring * sectors + place.sector_bin()) += 1;
      for (int channel = 0; channel < channels; ++channel) {
        const int bin = static_cast<int>(std::floor(colors(channel, i) / bin_width));
        signature(plane, shape_columns + (channel * circles + ring) * color_bins + bin) += 1;
      }
    }
  }
  return signature / static_cast<double>(cloud.size());
}

Eigen::VectorXd descriptor(const Eigen::MatrixXd& signature) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(signature, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const double sign = svd.matrixU().col(0).sum() < 0 ? -1 : 1;
  Eigen::VectorXd joined(signature.rows() + signature.cols());
  joined << sign * svd.matrixU().col(0), sign * svd.matrixV().col(0);
  return joined;
}

}  // namespace paper
