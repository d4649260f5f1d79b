// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "fusionslam/registration.hpp"
#include "gicp_kernel.hpp"
#include "rigid.hpp"
#include "surface_blocks.hpp"

namespace fusionslam {
namespace {

using detail::block_size;
using detail::Box;
using detail::GicpKernels;
using detail::Motion;
using detail::Nearest;
using detail::no_place;
using detail::PointBlock;
using detail::PointBlocks;

constexpr float infinity = std::numeric_limits<float>::infinity();
constexpr double farthest = 1e15;  // m, as of points: squares do not overflow

/// The normals of a cloud's points, block by block.
class NormalSearch {
 public:
  NormalSearch(const PointBlocks& cloud, std::size_t neighbors)
      : cloud_(cloud), kernels_(detail::gicp_kernels(simd_level())), smallest_(neighbors) {}

  PointBlock normals_of(std::size_t block) {
    const PointBlock& queries = cloud_.blocks()[block];
    const std::size_t used = std::min(block_size, cloud_.size() - block * block_size);
    find_smallest(block, used);
    float limit[block_size] = {};  // just above the distance to the last of the nearest, squared
    for (std::size_t i = 0; i < used; ++i)
      limit[i] = std::nextafter(smallest_.back().values[i], infinity);
    cloud_.blocks_within(cloud_.block_box(block), *std::max_element(limit, limit + block_size),
                         found_);
    detail::NeighborSums sums{};
    for (const std::uint32_t other : found_)
      if (cloud_.kernels().any_nearer(queries, cloud_.block_box(other), limit))
        kernels_.add_neighbors(queries, cloud_.blocks()[other], limit, sums);
    PointBlock normals;
    kernels_.find_normals(sums, normals);
    return normals;
  }

 private:
  struct alignas(64) Lanes {
    float values[block_size];
  };

  /// The squared distances of each point to its nearest ones.
  void find_smallest(std::size_t block, std::size_t used) {
    for (Lanes& lanes : smallest_) std::fill_n(lanes.values, block_size, infinity);
    float* last = smallest_.back().values;
    std::fill(last + used, last + block_size, 0.0F);  // unused places search for nothing
    // The block and its group come first, siblings before others: they leave little to search for.
    const std::size_t group = block / block_size * block_size;
    for (std::size_t i = 0; i < block_size; ++i)
      if ((block ^ i) < cloud_.block_count()) visit(block, block ^ i);
    cloud_.blocks_within(cloud_.block_box(block), *std::max_element(last, last + block_size),
                         found_);
    for (const std::uint32_t other : found_)
      if (other < group || other >= group + block_size) visit(block, other);
  }

  void visit(std::size_t block, std::size_t other) {
    const PointBlock& queries = cloud_.blocks()[block];
    if (cloud_.kernels().any_nearer(queries, cloud_.block_box(other), smallest_.back().values))
      kernels_.insert_smallest(queries, cloud_.blocks()[other], smallest_.size(),
                               &smallest_.front().values);
  }

  const PointBlocks& cloud_;
  GicpKernels kernels_;
  std::vector<Lanes> smallest_;  // of all queries the smallest first
  std::vector<std::uint32_t> found_;
};

/// The nearest neighbours of a cloud that moves. A point is searched for again only when it has
/// moved so far that another neighbour may be nearer: by the triangle inequality, half the
/// difference between the distances to the nearest and to the second.
class MovingSearch {
 public:
  MovingSearch(const PointBlocks& source, const PointBlocks& target, float distance)
      : source_(source),
        target_(target),
        kernels_(detail::gicp_kernels(simd_level())),
        distance_(distance),
        reach_(1.25F * distance),  // so that points without a neighbour are not searched each time
        slack_(1e-5F * distance),  // distances are rounded
        states_(source.block_count()),
        places_(source.block_count() * block_size, no_place) {}

  const std::uint32_t* places() const { return places_.data(); }

  void move(const Motion& motion) {
    for (std::size_t block = 0; block < states_.size(); ++block) {
      State& state = states_[block];
      PointBlock moved;
      alignas(64) float squared_moves[block_size];
      if (kernels_.move(source_.blocks()[block], motion, state.searched, state.squared_margin,
                        moved, squared_moves))
        search(block, moved, squared_moves);
    }
  }

 private:
  struct alignas(64) State {
    PointBlock searched{};             // where the points were when they were searched for
    float squared_margin[block_size];  // how far they may move from there
    float second[block_size];          // no other neighbour was nearer than that
    State() {
      std::fill_n(squared_margin, block_size, -1.0F);
      std::fill_n(second, block_size, infinity);
    }
  };

  void search(std::size_t block, const PointBlock& moved, const float* squared_moves) {
    detail::check_interrupt();
    State& state = states_[block];
    Nearest nearest;
    float bounds[block_size];
    Box box{{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}};
    float widest = 0;
    for (std::size_t i = 0; i < block_size; ++i) {
      nearest.place[i] = no_place;
      nearest.squared[i] = nearest.second[i] = -1;  // nothing is nearer
      if (!(squared_moves[i] > state.squared_margin[i])) continue;
      // Both neighbours of before are within this.
      bounds[i] = std::min(reach_, state.second[i] + std::sqrt(squared_moves[i]) + slack_);
      nearest.squared[i] = nearest.second[i] = bounds[i] * bounds[i];
      widest = std::max(widest, nearest.second[i]);
      const float point[3] = {moved.x[i], moved.y[i], moved.z[i]};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box.low[axis] = std::min(box.low[axis], point[axis]);
        box.high[axis] = std::max(box.high[axis], point[axis]);
      }
    }
    find_nearest(moved, box, widest, nearest);
    for (std::size_t i = 0; i < block_size; ++i) {
      if (!(squared_moves[i] > state.squared_margin[i])) continue;
      state.searched.x[i] = moved.x[i];
      state.searched.y[i] = moved.y[i];
      state.searched.z[i] = moved.z[i];
      places_[block * block_size + i] = nearest.place[i];
      state.second[i] = std::sqrt(nearest.second[i]);
      const float margin = nearest.place[i] == no_place
                               ? bounds[i] - distance_
                               : (state.second[i] - std::sqrt(nearest.squared[i])) / 2;
      const float safe = margin - slack_;
      state.squared_margin[i] = safe > 0 ? safe * safe : -1.0F;
    }
  }

  /// Visits the blocks that can hold a nearer point, the one nearest to the queries first.
  void find_nearest(const PointBlock& queries, const Box& box, float widest, Nearest& nearest) {
    target_.blocks_within(box, widest, found_);
    if (found_.empty()) return;
    float least = infinity;
    std::size_t first = 0;
    for (std::size_t i = 0; i < found_.size(); ++i)
      if (const float apart = squared_center_distance(target_.block_box(found_[i]), box);
          apart < least) {
        least = apart;
        first = i;
      }
    std::swap(found_[0], found_[first]);
    for (const std::uint32_t other : found_)
      if (target_.kernels().any_nearer(queries, target_.block_box(other), nearest.second))
        kernels_.lower_nearest(queries, target_.blocks()[other],
                               other * static_cast<std::uint32_t>(block_size), nearest);
  }

  static float squared_center_distance(const Box& one, const Box& other) {
    float sum = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float apart =
          (one.low[axis] + one.high[axis]) / 2 - (other.low[axis] + other.high[axis]) / 2;
      sum += apart * apart;
    }
    return sum;
  }

  const PointBlocks& source_;
  const PointBlocks& target_;
  GicpKernels kernels_;
  float distance_, reach_, slack_;
  std::vector<State> states_;
  std::vector<std::uint32_t> places_;
  std::vector<std::uint32_t> found_;
};

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

struct Pose {
  Eigen::Quaterniond rotation;
  Eigen::Vector3d shift;

  Motion motion() const {
    const Eigen::Matrix3d matrix = rotation.toRotationMatrix();
    Motion motion{};
    for (int i = 0; i < 9; ++i) motion.rotation[i] = static_cast<float>(matrix(i / 3, i % 3));
    for (int i = 0; i < 3; ++i) motion.shift[i] = static_cast<float>(shift[i]);
    return motion;
  }

  /// The pose after a motion of the source in its own frame. No sine or cosine: their last bits
  /// differ between machines.
  Pose stepped(const Vector6& step) const {
    const Eigen::Vector3d half = step.tail<3>() / 2;
    const Eigen::Quaterniond turn(1, half.x(), half.y(), half.z());
    return {(rotation * turn).normalized(), shift + rotation * step.head<3>()};
  }
};

Matrix6 full(const double* upper) {
  Matrix6 matrix;
  for (int row = 0; row < 6; ++row)
    for (int column = row; column < 6; ++column)
      matrix(row, column) = matrix(column, row) = *upper++;
  return matrix;
}

/// Levenberg's and Marquardt's steps over the pairs that are nearest neighbours at each pose.
class Refiner {
 public:
  Refiner(const detail::SurfaceBlocks& source, const detail::SurfaceBlocks& target,
          const RefinementLimits& limits)
      : limits_(limits),
        kernels_(detail::gicp_kernels(simd_level())),
        search_(source.cloud, target.cloud, static_cast<float>(limits.distance)),
        pairs_(source.cloud.block_count() * block_size),
        pairing_{source.cloud.blocks(), source.normals.data(), target.cloud.blocks(),
                 target.normals.data(), search_.places(),      source.cloud.block_count()} {}

  Refinement run(Pose pose) {
    Refinement found{};
    linearize(pose);
    while (found.iterations < limits_.iterations && !found.converged && equations_.inliers > 0) {
      detail::check_interrupt();
      ++found.iterations;
      found.converged = !step(pose);
      linearize(pose);
    }
    const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
    found.target_from_source = identity_transform;
    for (std::size_t i = 0; i < 12; ++i) {
      const auto row = static_cast<int>(i / 4), column = static_cast<int>(i % 4);
      found.target_from_source[i] = column < 3 ? rotation(row, column) : pose.shift[row];
    }
    const Matrix6 information = full(equations_.information);
    std::copy_n(information.data(), 36, found.information.begin());
    found.error = equations_.error;
    found.inliers = static_cast<std::size_t>(equations_.inliers);
    return found;
  }

 private:
  void linearize(const Pose& pose) {
    const Motion motion = pose.motion();
    search_.move(motion);
    const auto distance = static_cast<float>(limits_.distance);
    kernels_.linearize(pairing_, motion, distance * distance, pairs_.data(), equations_);
  }

  /// Moves the pose to where the pairs fit better; whether it is worth a further step.
  bool step(Pose& pose) {
    detail::Pairing fixed = pairing_;
    fixed.places = pairs_.data();
    const Matrix6 information = full(equations_.information);
    const Vector6 gradient = Eigen::Map<const Vector6>(equations_.gradient);
    constexpr int most_tries = 10;
    for (int i = 0; i < most_tries; ++i, damping_ *= 10) {
      Matrix6 damped = information;
      damped.diagonal() *= 1 + damping_;
      const Vector6 step = damped.ldlt().solve(gradient);
      if (!step.allFinite()) continue;
      const Pose next = pose.stepped(step);
      if (!(kernels_.sum_error(fixed, next.motion()) <= equations_.error)) continue;
      pose = next;
      damping_ = std::max(damping_ / 10, least_damping);
      return step.head<3>().norm() >= limits_.step || step.tail<3>().norm() >= limits_.step;
    }
    return false;
  }

  static constexpr double least_damping = 1e-6;
  RefinementLimits limits_;
  GicpKernels kernels_;
  MovingSearch search_;
  std::vector<std::uint32_t> pairs_;  // of the last linearisation
  detail::Pairing pairing_;
  detail::NormalEquations equations_{};
  double damping_ = 1e-3;
};

void check_limits(const RefinementLimits& limits) {
  if (!(limits.distance > 0 && limits.distance <= farthest))
    throw ConfigError("distance is " + std::to_string(limits.distance) +
                      ", expected up to 1e15 m, not 0");
  if (limits.iterations < 1)
    throw ConfigError("iterations is " + std::to_string(limits.iterations) +
                      ", expected 1 or more");
  if (!(limits.step > 0 && std::isfinite(limits.step)))
    throw ConfigError("step is " + std::to_string(limits.step) + ", expected more than 0");
}

}  // namespace

SurfaceCloud::SurfaceCloud(PointsView points, int neighbors) {
  if (neighbors < 3 || neighbors > static_cast<int>(detail::most_neighbors))
    throw ConfigError("neighbors is " + std::to_string(neighbors) + ", expected 3 to 64");
  const auto count = static_cast<std::size_t>(neighbors);
  detail::check_points(points, std::max(fewest_surface_points, count), "registration");
  auto made = std::make_shared<detail::SurfaceBlocks>(
      detail::SurfaceBlocks{PointBlocks(points, 1, simd_level()), {}, neighbors});
  NormalSearch search(made->cloud, count);
  for (std::size_t block = 0; block < made->cloud.block_count(); ++block) {
    detail::check_interrupt();
    made->normals.push_back(search.normals_of(block));
  }
  blocks_ = std::move(made);
}

std::size_t SurfaceCloud::size() const { return blocks_->cloud.size(); }

int SurfaceCloud::neighbors() const { return blocks_->neighbors; }

std::vector<float> SurfaceCloud::points() const {
  const PointBlocks& cloud = blocks_->cloud;
  std::vector<float> points(3 * cloud.size());
  for (std::size_t place = 0; place < cloud.size(); ++place) {
    const PointBlock& block = cloud.blocks()[place / block_size];
    float* point = points.data() + 3 * std::size_t{cloud.indices()[place]};
    point[0] = block.x[place % block_size];
    point[1] = block.y[place % block_size];
    point[2] = block.z[place % block_size];
  }
  return points;
}

Refinement refine_pose(const SurfaceCloud& source, const SurfaceCloud& target,
                       const Transform& start, const RefinementLimits& limits) {
  check_limits(limits);
  if (!detail::is_rigid(start)) throw DataError("the start is no rigid motion");
  if (!(std::abs(start[3]) + std::abs(start[7]) + std::abs(start[11]) <= farthest))
    throw DataError("the start is more than 1e15 m from the origin");
  Eigen::Matrix3d rotation;
  for (int i = 0; i < 9; ++i)
    rotation(i / 3, i % 3) = start[static_cast<std::size_t>(i / 3 * 4 + i % 3)];
  const Pose pose{Eigen::Quaterniond(rotation).normalized(), {start[3], start[7], start[11]}};
  return Refiner(source.blocks(), target.blocks(), limits).run(pose);
}

}  // namespace fusionslam
