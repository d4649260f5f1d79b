// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// RatSLAM's experience map: places, links between them, and where the robot is on the map.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "fusionslam/config.hpp"

namespace fusionslam {

/// Presets of the experience map.
enum class MapPreset { robust, openratslam };

template <>
struct ChoiceNames<MapPreset> {
  static constexpr std::array<std::string_view, 2> value{"robust", "openratslam"};
};

/// Parameters of map correction and of the acceptance of loops.
struct ExperienceMapConfig {
  static constexpr const char* section = "map";

  MapPreset preset = MapPreset::robust;
  double initial_heading = 0.0;
  int loops = 20;
  double correction = 0.5;
  double drift_m = 0.03;
  double drift_turn = 0.01;
  double drift_heading = 0.005;
  double place_m = 0.4;
  double place_rad = 0.2;
  double sigmas = 3.0;
  int agreeing = 64;
  double agreed_sigmas = 9.0;
  double agreement_m = 0.5;
  int rejoin = 4;
  double outlier = 3.0;
  int work = 30;
  double tolerance = 1e-4;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("preset", config.preset,
            OptionInfo{"robust (ours) or openratslam (as the program of Ball et al. 2013)", ""});
    visitor("initial_heading", config.initial_heading,
            OptionInfo{"heading of the robot at the start", "rad", -7, 7});
    visitor("loops", config.loops,
            OptionInfo{"openratslam: relaxation sweeps after each action", "", 1, 1e6});
    visitor("correction", config.correction,
            OptionInfo{"openratslam: share of a link's error that each of its ends moves by", "", 0,
                       0.5});
    visitor("drift_m", config.drift_m,
            OptionInfo{"standard deviation of odometry's position after one metre", "m/sqrt(m)",
                       1e-4, 10});
    visitor("drift_turn", config.drift_turn,
            OptionInfo{"standard deviation of its heading after a turn of one radian",
                       "rad/sqrt(rad)", 1e-5, 10});
    visitor(
        "drift_heading", config.drift_heading,
        OptionInfo{"standard deviation of its heading after one metre", "rad/sqrt(m)", 1e-5, 10});
    visitor("place_m", config.place_m,
            OptionInfo{"standard deviation of the position that a recognised view gives", "m", 1e-3,
                       100});
    visitor("place_rad", config.place_rad,
            OptionInfo{"standard deviation of the heading that it gives", "rad", 1e-3, 10});
    visitor("sigmas", config.sigmas,
            OptionInfo{"accept a loop up to this many standard deviations from odometry", "", 0.1,
                       1e6});
    visitor(
        "agreeing", config.agreeing,
        OptionInfo{"beyond `sigmas`, accept a loop only if at least this many loops agree (itself "
                   "included)",
                   "", 2, 64});
    visitor(
        "agreed_sigmas", config.agreed_sigmas,
        OptionInfo{"reject a loop beyond this many standard deviations, whatever agrees with it",
                   "", 0, 1e6});
    visitor("agreement_m", config.agreement_m,
            OptionInfo{"loops agree only if the drift between them is at most this", "m", 0, 1e6});
    visitor(
        "rejoin", config.rejoin,
        OptionInfo{"after an interruption of odometry, accept a loop beyond `sigmas` if at least "
                   "this many loops since then agree (itself included)",
                   "", 2, 64});
    visitor("outlier", config.outlier,
            OptionInfo{"standard deviations from which on a loop's link pulls no harder", "", 0.1,
                       1e6});
    visitor("work", config.work,
            OptionInfo{"work limit per action: this many nodes plus 2 % of the map", "", 1, 1e9});
    visitor("tolerance", config.tolerance,
            OptionInfo{"stop relaxing when no node moves farther than this", "m", 1e-12, 1});
  }
};

/// Kinds of change; the values are those of OpenRatSLAM.
enum class ActionKind : int { none = 0, create_node = 1, create_edge = 2 };

/// A change of the map: a new node, or an edge to a known one. `source` is the node that the robot
/// was at (0 before the first one), `target` the one that it is at now.
struct MapAction {
  ActionKind kind = ActionKind::none;
  std::int64_t source = 0;
  std::int64_t target = 0;
  double relative_rotation = 0;  ///< rad, of the robot against the target
  double relative_x = 0;         ///< m, the robot in the frame of the target
  double relative_y = 0;         ///< m
};

/// A pose in the plane.
struct Pose2 {
  double x = 0;        ///< m
  double y = 0;        ///< m
  double heading = 0;  ///< rad, in (-pi, pi]
};

/// A link between two nodes, as odometry measured it.
struct MapLink {
  std::int64_t source = 0;
  std::int64_t target = 0;
  double distance = 0;  ///< m
  double heading = 0;   ///< rad, direction of the target from the source's heading
  double facing = 0;    ///< rad, rotation from the source's heading
  double duration = 0;  ///< s
  double sd_m = 0;  ///< m, standard deviation of the position, each axis: its weight in relaxation
  double sd_rad = 0;  ///< rad, standard deviation of the rotation
};

/// Result of checking a loop against odometry.
struct LoopCheck {
  bool accepted = true;
  double error_m = 0;      ///< between where the map and where the loop puts the robot
  double error_rad = 0;    ///< likewise
  double allowed_m = 0;    ///< `sigmas` standard deviations in the direction of the error
  double allowed_rad = 0;  ///< likewise
  std::string reason;
};

/// Result of a relaxation.
struct Relaxation {
  double residual_m = 0;    ///< root mean square position error of the links; openratslam: before
                            ///< their turns in the last sweep
  double residual_rad = 0;  ///< and rotation error
  double step_m = 0;        ///< farthest move of a node in the last step
  std::int64_t sweeps = 0;  ///< sweeps, or Gauss-Newton steps
  std::int64_t nodes = 0;   ///< nodes in the largest part that was solved
  bool settled = true;      ///< no work is left for later actions
};

/// The complete state of a map; restore() checks it.
struct MapState {
  std::vector<double> nodes;         ///< n x 3
  std::vector<std::int64_t> ends;    ///< m x 2
  std::vector<double> links;         ///< m x 6: distance, heading, facing, duration, variances
  std::vector<std::uint8_t> loops;   ///< m: whether a view made the link
  std::vector<double> robot;         ///< robot_values
  std::vector<std::int64_t> counts;  ///< robot_counts
  std::vector<std::int64_t> due;     ///< nodes whose surroundings are to be relaxed
  std::vector<std::int64_t> pending_ends;   ///< p x 2
  std::vector<double> pending;              ///< p x 12
  std::vector<std::int64_t> interruptions;  ///< first nodes after unresolved ones, ascending

  static constexpr std::size_t link_values = 6, robot_values = 14, robot_counts = 2,
                               pending_values = 12;
};

/// The graph of places that a robot has visited (Milford & Wyeth 2004; Ball et al. 2013).
/// Threads may share it through const members while none changes it.
class ExperienceMap {
 public:
  explicit ExperienceMap(const ExperienceMapConfig& config = {});
  ~ExperienceMap();
  ExperienceMap(ExperienceMap&&) noexcept;
  ExperienceMap& operator=(ExperienceMap&&) noexcept;

  /// Moves the robot on from the current node. Throws DataError for values that are not finite and
  /// for a negative time.
  void on_odometry(double v, double w, double dt);

  /// Notes that odometry was interrupted: the robot may have been carried, so what comes next may
  /// be anywhere on the map. The next loop to an older node that fits odometry ends the doubt;
  /// `rejoin` loops that contradict it but agree with each other move all nodes since then (see
  /// apply).
  void mark_interruption();

  /// As above, but it was before a node was made. Interruptions since then are forgotten. Throws
  /// DataError if there is no such node, or it is the first one.
  void mark_interruption_before(std::int64_t node);

  /// Corrects what odometry has measured so far: its distances by the factor `way`, its turns by
  /// `turn`. Call relax afterwards. Throws DataError for factors that are not above 0 and finite.
  void rescale_odometry(double way, double turn);

  /// Says how far the factors that odometry's distances and turns are off by may still be from 1,
  /// as standard deviations; 0 by default. Throws DataError for values that are negative or not
  /// finite.
  void set_odometry_deviations(double way, double turn);

  /// Checks whether a loop fits the map and its drift. A loop that does not is remembered, for
  /// later ones to agree with; checking twice changes nothing. Throws DataError for an unknown
  /// target.
  LoopCheck check(const MapAction& action);

  /// Applies an action. An edge across an interruption of odometry that contradicts odometry first
  /// moves all nodes since the interruption, as one piece, to where it says. Throws DataError for a
  /// new node that is not the next one, or an edge to an unknown one.
  void apply(const MapAction& action);

  /// Moves nodes until links fit. With `whole` all of them, until they converge.
  Relaxation relax(bool whole = false);

  std::size_t size() const;
  std::size_t links() const;
  Pose2 node(std::size_t id) const;
  MapLink link(std::size_t number) const;
  std::int64_t current() const;
  Pose2 pose() const;
  /// The pose in the frame of the current node.
  Pose2 offset() const;
  const ExperienceMapConfig& config() const;

  MapState state() const;
  /// Throws DataError for an impossible state; the map is then unchanged.
  void restore(const MapState& state);

 private:
  struct Storage;
  std::unique_ptr<Storage> map_;
};

}  // namespace fusionslam
