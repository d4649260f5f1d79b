// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// How far odometry may be off: the same model of drift checks RatSLAM's loops in the plane.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "fusionslam/config.hpp"

namespace fusionslam {

/// A rigid motion, row by row.
using Pose3 = std::array<double, 16>;

/// Of a pose's error, row by row: x, y, z in metres, then rotations about x, y, z in radians, as
/// small motions in the pose's own frame.
using PoseCovariance = std::array<double, 36>;

/// How the error of odometry grows with motion: random walks, whose variances add up.
struct DriftConfig {
  static constexpr const char* section = "drift";

  double drift_m = 0.03;
  double drift_height = 0.03;
  double drift_turn = 0.01;
  double drift_heading = 0.005;
  double drift_tilt = 0.005;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("drift_m", config.drift_m,
            OptionInfo{"standard deviation of odometry's position after one metre, along x and y",
                       "m/sqrt(m)", 1e-4, 10});
    visitor("drift_height", config.drift_height,
            OptionInfo{"standard deviation of its position along z after one metre", "m/sqrt(m)",
                       1e-4, 10});
    visitor("drift_turn", config.drift_turn,
            OptionInfo{"standard deviation of its rotation after a turn of one radian",
                       "rad/sqrt(rad)", 1e-5, 10});
    visitor(
        "drift_heading", config.drift_heading,
        OptionInfo{"standard deviation of its heading after one metre", "rad/sqrt(m)", 1e-5, 10});
    visitor("drift_tilt", config.drift_tilt,
            OptionInfo{"standard deviation of its roll and pitch after one metre", "rad/sqrt(m)",
                       1e-5, 10});
  }
};

/// Covariance of odometry's error over a motion.
PoseCovariance drift_covariance(const DriftConfig& config, const Pose3& motion);

/// How a measured pose fits odometry: it does if no error is larger than allowed.
struct DriftFit {
  double error_m = 0;      ///< between where odometry and where the measurement has the node
  double error_rad = 0;    ///< likewise
  double allowed_m = 0;    ///< so many standard deviations in the direction of the error
  double allowed_rad = 0;  ///< likewise
};

/// Poses of nodes by odometry alone, and the drift between any two that it connects.
class OdometryTree {
 public:
  /// Adds a node at which odometry begins; returns its number.
  std::int64_t add_root(const Pose3& pose);

  /// Adds the node at the other end of a step of odometry, parent_from_node; `backwards`:
  /// node_from_parent. The covariance is that of the step as it is given.
  std::int64_t add(std::int64_t parent, const Pose3& step, const PoseCovariance& covariance,
                   bool backwards);

  /// Covariance of the error of a_from_b by odometry. Throws DataError for an unknown node, and if
  /// odometry does not connect them.
  PoseCovariance drift(std::int64_t a, std::int64_t b) const;

  /// Compares the measured pose a_from_b with odometry. `error` is the small motion from where the
  /// measurement has b to where odometry has it. Throws as drift().
  DriftFit fit(std::int64_t a, std::int64_t b, const std::array<double, 6>& error,
               const PoseCovariance& covariance, double sigmas) const;

  std::int64_t size() const { return static_cast<std::int64_t>(nodes_.size()); }
  const Pose3& pose(std::int64_t node) const;
  std::int64_t root(std::int64_t node) const;
  std::int64_t parent(std::int64_t node) const;
  /// Covariance of all steps from the root to a node, as they move the root, in the axes of poses.
  const PoseCovariance& total(std::int64_t node) const;

  /// Puts the tree into a state that pose(), total() and parent() of all nodes gave; a root is its
  /// own parent. Throws DataError for an impossible one; the tree is then unchanged.
  void restore(const std::vector<Pose3>& poses, const std::vector<PoseCovariance>& totals,
               const std::vector<std::int64_t>& parents);

 private:
  struct Node {
    Pose3 pose;
    PoseCovariance total;
    std::int64_t parent, root;
    std::int64_t jump;  ///< an ancestor farther up (Myers 1983)
    std::int64_t depth;
  };

  static Node place_node(const std::vector<Node>& nodes, const Pose3& pose,
                         const PoseCovariance& total, std::int64_t parent);
  const Node& at(std::int64_t node) const;
  std::int64_t meet(std::int64_t a, std::int64_t b) const;

  std::vector<Node> nodes_;
};

}  // namespace fusionslam
