// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
/// M2DP (He, Wang, Zhang, IROS 2016) and c-M2DP (Perdomo 2019, chapter 3) word by word: double
/// precision, sqrt, atan2, floor and a Jacobi SVD, with the parameters of the publications.
/// The reference that the tests compare with and the peer of the benchmark. Written to be read.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>

namespace paper {

constexpr int azimuths = 4;     // p
constexpr int elevations = 16;  // q
constexpr int circles = 8;      // l
constexpr int sectors = 16;     // t
constexpr int color_bins = 16;  // g
constexpr int channels = 3;     // w
constexpr int planes = azimuths * elevations;
constexpr int shape_columns = circles * sectors;
constexpr int color_columns = channels * circles * color_bins;

/// One point a column, metres, not all on one line.
using Points = Eigen::Matrix3Xd;
/// One RGB colour a column.
using Colors = Eigen::Matrix<std::uint8_t, 3, Eigen::Dynamic>;

/// Rows are the x and y axis of a projection plane.
using PlaneAxes = Eigen::Matrix<double, 2, 3>;

/// Plane number azimuth * elevations + elevation: its x axis is (1, 0, 0) without the part along
/// the normal, its y axis the normal x that.
PlaneAxes plane_axes(int plane);

/// Where a point of the cloud falls on one plane, in widths of a bin: ring in [0, circles], sector
/// in [0, sectors].
struct Place {
  double ring;
  double sector;

  int ring_bin() const;
  int sector_bin() const;
  /// To the nearest edge between two bins, in widths of a bin.
  double edge_distance() const;
};

/// The cloud in its own frame: what both signatures count.
class AlignedCloud {
 public:
  /// Subtracts the mean and turns the principal axes to x, y, z, longest first, the entry of
  /// largest magnitude of each axis positive.
  explicit AlignedCloud(const Points& points);

  Eigen::Index size() const { return points_.cols(); }
  Place place(const PlaneAxes& axes, Eigen::Index point) const;

 private:
  Points points_;
  double sqrt_rho_max_;  // rho_max: the largest distance of a point from the mean
};

/// Signature matrix of M2DP, planes x shape_columns, counts / n.
Eigen::MatrixXd m2dp_signature(const AlignedCloud& cloud);

/// Signature matrix of c-M2DP: the same with color_columns more, one histogram for each channel and
/// circle.
Eigen::MatrixXd cm2dp_signature(const AlignedCloud& cloud, const Colors& colors);

/// First left and first right singular vector, one after the other, signs such that both are >= 0.
Eigen::VectorXd descriptor(const Eigen::MatrixXd& signature);

}  // namespace paper
