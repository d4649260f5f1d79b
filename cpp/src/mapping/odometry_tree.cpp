// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <utility>

#include "fusionslam/errors.hpp"
#include "fusionslam/mapping.hpp"
#include "pose_drift.hpp"

namespace fusionslam {
namespace {

using detail::PoseDrift;
using Drift = PoseDrift<3, 3>;
using Matrix = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
using Covariance = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
using Rotation = Eigen::Matrix3d;

Eigen::Map<const Matrix> matrix(const Pose3& pose) { return Eigen::Map<const Matrix>(pose.data()); }

Rotation rotation(const Pose3& pose) { return matrix(pose).topLeftCorner<3, 3>(); }

Eigen::Vector3d place(const Pose3& pose) { return matrix(pose).topRightCorner<3, 1>(); }

Eigen::Map<const Covariance> covariance(const PoseCovariance& values) {
  return Eigen::Map<const Covariance>(values.data());
}

/// A covariance in other axes.
Drift turned(const PoseCovariance& given, const Rotation& rotation) {
  const auto values = covariance(given);
  Drift drift;
  drift.place = rotation * values.topLeftCorner<3, 3>() * rotation.transpose();
  drift.mixed = rotation * values.topRightCorner<3, 3>() * rotation.transpose();
  drift.turn = rotation * values.bottomRightCorner<3, 3>() * rotation.transpose();
  return drift;
}

PoseCovariance covariance_of(const Drift& drift) {
  PoseCovariance covariance;
  Eigen::Map<Covariance> values(covariance.data());
  values << drift.place, drift.mixed, drift.mixed.transpose(), drift.turn;
  return covariance;
}

Pose3 pose_of(const Matrix& values) {
  Pose3 pose;
  Eigen::Map<Matrix>(pose.data()) = values;
  return pose;
}

Matrix inverse(const Pose3& pose) {
  Matrix inverted = Matrix::Identity();
  inverted.topLeftCorner<3, 3>() = rotation(pose).transpose();
  inverted.topRightCorner<3, 1>() = -rotation(pose).transpose() * place(pose);
  return inverted;
}

}  // namespace

PoseCovariance drift_covariance(const DriftConfig& config, const Pose3& motion) {
  const double metres = place(motion).norm();
  const double turn = Eigen::AngleAxisd(rotation(motion)).angle();
  const auto turned_by = [&](double drift) {
    return detail::turn_variance(config.drift_turn, turn, drift, metres);
  };
  const double tilt = turned_by(config.drift_tilt), heading = turned_by(config.drift_heading);
  const double flat =
      detail::place_variance(config.drift_m, metres) + detail::swing_variance(heading, metres);
  const double height =
      detail::place_variance(config.drift_height, metres) + detail::swing_variance(tilt, metres);
  Eigen::Vector<double, 6> variances;
  variances << flat, flat, height, tilt, tilt, heading;
  PoseCovariance covariance;
  Eigen::Map<Covariance>(covariance.data()) =
      (variances.array() + detail::least_variance).matrix().asDiagonal();
  return covariance;
}

std::int64_t OdometryTree::add_root(const Pose3& pose) {
  const std::int64_t node = size();
  nodes_.push_back(place_node(nodes_, pose, {}, node));
  return node;
}

std::int64_t OdometryTree::add(std::int64_t parent, const Pose3& step,
                               const PoseCovariance& covariance, bool backwards) {
  const Node& before = at(parent);
  const Pose3 pose = pose_of(matrix(before.pose) * (backwards ? inverse(step) : matrix(step)));
  // The covariance is in the frame of the step's last node.
  const Pose3& end = backwards ? before.pose : pose;
  Drift total = turned(before.total, Rotation::Identity());
  total.add(turned(covariance, rotation(end)), place(nodes_[before.root].pose) - place(end));
  nodes_.push_back(place_node(nodes_, pose, covariance_of(total), parent));
  return size() - 1;
}

PoseCovariance OdometryTree::drift(std::int64_t a, std::int64_t b) const {
  if (at(a).root != at(b).root)
    throw DataError("nodes " + std::to_string(a) + " and " + std::to_string(b) +
                    " are of different sessions: no odometry leads from one to the other");
  const PoseCovariance &first = nodes_[a].total, &last = nodes_[b].total,
                       &common = nodes_[meet(a, b)].total;
  PoseCovariance between;
  for (std::size_t i = 0; i < between.size(); ++i) between[i] = first[i] + last[i] - 2 * common[i];
  const Rotation to_b = rotation(nodes_[b].pose).transpose();
  Drift drift;
  drift.add(turned(between, to_b),
            to_b * (place(nodes_[b].pose) - place(nodes_[nodes_[b].root].pose)));
  return covariance_of(drift);
}

DriftFit OdometryTree::fit(std::int64_t a, std::int64_t b, const std::array<double, 6>& error,
                           const PoseCovariance& covariance, double sigmas) const {
  Drift total = turned(drift(a, b), Rotation::Identity());
  total.add(turned(covariance, Rotation::Identity()), Eigen::Vector3d::Zero());
  const Eigen::Map<const Eigen::Vector3d> place_error(error.data()), turn(error.data() + 3);
  return total.fit(place_error, turn, sigmas);
}

void OdometryTree::restore(const std::vector<Pose3>& poses,
                           const std::vector<PoseCovariance>& totals,
                           const std::vector<std::int64_t>& parents) {
  if (totals.size() != poses.size() || parents.size() != poses.size())
    throw DataError("state of an odometry tree: arrays of different lengths");
  std::vector<Node> nodes;
  nodes.reserve(poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const auto node = static_cast<std::int64_t>(i);
    if (parents[i] < 0 || parents[i] > node)
      throw DataError("state of an odometry tree: node " + std::to_string(i) + " has the parent " +
                      std::to_string(parents[i]));
    if (!(matrix(poses[i]).allFinite() && covariance(totals[i]).allFinite()))
      throw DataError("state of an odometry tree: node " + std::to_string(i) + " is not finite");
    nodes.push_back(place_node(nodes, poses[i], totals[i], parents[i]));
  }
  nodes_ = std::move(nodes);
}

OdometryTree::Node OdometryTree::place_node(const std::vector<Node>& nodes, const Pose3& pose,
                                            const PoseCovariance& total, std::int64_t parent) {
  const auto node = static_cast<std::int64_t>(nodes.size());
  if (parent == node) return {pose, total, node, node, node, 0};
  const Node& before = nodes[parent];
  const Node& far = nodes[before.jump];
  const bool doubled = before.depth - far.depth == far.depth - nodes[far.jump].depth;
  return {pose, total, parent, before.root, doubled ? far.jump : parent, before.depth + 1};
}

const Pose3& OdometryTree::pose(std::int64_t node) const { return at(node).pose; }

std::int64_t OdometryTree::root(std::int64_t node) const { return at(node).root; }

std::int64_t OdometryTree::parent(std::int64_t node) const { return at(node).parent; }

const PoseCovariance& OdometryTree::total(std::int64_t node) const { return at(node).total; }

const OdometryTree::Node& OdometryTree::at(std::int64_t node) const {
  if (node < 0 || node >= size())
    throw DataError("node " + std::to_string(node) + ": odometry knows " + std::to_string(size()));
  return nodes_[node];
}

/// The node at which the ways from both to their root meet.
std::int64_t OdometryTree::meet(std::int64_t a, std::int64_t b) const {
  if (nodes_[a].depth > nodes_[b].depth) std::swap(a, b);
  const std::int64_t depth = nodes_[a].depth;
  while (nodes_[b].depth > depth) {
    const std::int64_t jump = nodes_[b].jump;
    b = nodes_[jump].depth >= depth ? jump : nodes_[b].parent;
  }
  while (a != b) {
    const bool apart = nodes_[a].jump != nodes_[b].jump;
    a = apart ? nodes_[a].jump : nodes_[a].parent;
    b = apart ? nodes_[b].jump : nodes_[b].parent;
  }
  return a;
}

}  // namespace fusionslam
