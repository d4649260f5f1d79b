// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The drift of odometry, in the plane (2 axes, 1 rotation) and in space (3 and 3).
#pragma once

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <cmath>

#include "fusionslam/mapping.hpp"

namespace fusionslam::detail {

/// Variance that every step has at least: 0 would give it unlimited weight.
constexpr double least_variance = 1e-6;

/// Variance of the position after some metres: a random walk.
inline double place_variance(double drift_m, double metres) { return drift_m * drift_m * metres; }

/// Variance of a rotation after some metres and a turn.
inline double turn_variance(double drift_turn, double turn, double drift_heading, double metres) {
  return drift_turn * drift_turn * turn + drift_heading * drift_heading * metres;
}

/// Variance of the position that comes from a rotation's: on a path of length d, an error that
/// grows as a random walk moves the end by d / sqrt(3) times its final deviation.
inline double swing_variance(double variance_rad, double metres) {
  return variance_rad / 3 * metres * metres;
}

/// Covariance of the error of a pose: a small translation and rotation.
template <int Axes, int Turns>
struct PoseDrift {
  using Place = Eigen::Matrix<double, Axes, 1>;
  using Turn = Eigen::Matrix<double, Turns, 1>;
  using Lever = Eigen::Matrix<double, Axes, Turns>;

  Eigen::Matrix<double, Axes, Axes> place = Eigen::Matrix<double, Axes, Axes>::Zero();  ///< m^2
  Lever mixed = Lever::Zero();                                                          ///< m rad
  Eigen::Matrix<double, Turns, Turns> turn = Eigen::Matrix<double, Turns, Turns>::Zero();

  static PoseDrift isotropic(double variance_m, double variance_rad) {
    PoseDrift drift;
    drift.place.diagonal().setConstant(variance_m);
    drift.turn.diagonal().setConstant(variance_rad);
    return drift;
  }

  /// Adds the error of a step as it shows at a place that is `away` from the end of the step: a
  /// rotation moves it in proportion to its distance.
  void add(const PoseDrift& step, const Place& away) {
    const Lever lever = lever_of(away);
    const Lever turned = lever * step.turn;
    const auto crossed = (step.mixed * lever.transpose()).eval();
    place += step.place + crossed + crossed.transpose() + turned * lever.transpose();
    mixed += step.mixed + turned;
    turn += step.turn;
  }

  /// Variance of the position in a direction; of no direction, the largest.
  double along(const Place& direction) const { return variance(place, direction); }

  double largest() const { return along(Place::Zero()); }

  /// Compares an error with its covariance.
  DriftFit fit(const Place& error, const Turn& rotation, double sigmas) const {
    return {error.norm(), rotation.norm(), sigmas * std::sqrt(along(error)),
            sigmas * std::sqrt(variance(turn, rotation))};
  }

 private:
  /// How a place moves with small rotations about an origin that is `away` from it, backwards.
  static Lever lever_of(const Place& away) {
    if constexpr (Axes == 2)
      return Lever(-away[1], away[0]);
    else
      return (Lever() << 0, away[2], -away[1], -away[2], 0, away[0], away[1], -away[0], 0)
          .finished();
  }

  template <int Size>
  static double variance(const Eigen::Matrix<double, Size, Size>& covariance,
                         const Eigen::Matrix<double, Size, 1>& direction) {
    const double square = direction.squaredNorm();
    if (square > 0) return direction.dot(covariance * direction) / square;
    if constexpr (Size == 1)
      return covariance(0, 0);
    else if constexpr (Size == 2)
      return (covariance(0, 0) + covariance(1, 1)) / 2 +
             std::hypot((covariance(0, 0) - covariance(1, 1)) / 2, covariance(0, 1));
    else
      return Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, Size, Size>>(
                 covariance, Eigen::EigenvaluesOnly)
          .eigenvalues()[Size - 1];
  }
};

}  // namespace fusionslam::detail
