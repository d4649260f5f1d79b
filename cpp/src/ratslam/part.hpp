// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// A part of the map and its least squares problem: every link's squared error over its variance;
// links of loops with Huber's loss.
#pragma once

#include <Eigen/SparseCore>
#include <cstdint>
#include <vector>

#include "map_arrays.hpp"

namespace fusionslam::detail {

/// Distance that a node would move by itself: its links' pull over their stiffness.
double unrest(const MapArrays& map, std::int64_t node);

/// Some nodes of the map, all others held where they are, and the links that they are part of.
class Part {
 public:
  using Matrix = Eigen::SparseMatrix<double>;
  using Vector = Eigen::VectorXd;

  struct Sums {
    double cost = 0, squares_m = 0, squares_rad = 0;
  };

  Part(MapArrays& map, std::vector<std::int64_t> nodes);
  ~Part();
  Part(const Part&) = delete;
  Part& operator=(const Part&) = delete;

  std::int64_t size() const { return static_cast<std::int64_t>(nodes_.size()); }

  /// Computes the links' errors where the nodes are now.
  Sums evaluate();

  /// Half the gradient at the last evaluation and, if `hessian` is not null, half of Gauss and
  /// Newton's approximation of the Hessian: its lower triangle, of the same pattern each time.
  void linearize(Vector& gradient, Matrix* hessian) const;

  /// True if factors of the Hessian take no more than some seconds and a gigabyte. Links between
  /// places all over the map fill them up, which no drive does.
  bool has_sparse_factors() const;

  void move(const Vector& step, double share);
  std::vector<Pose2> poses() const;
  void put_back(const std::vector<Pose2>& poses);

  /// The most unrest of a node next to the part.
  double unrest_beside() const;

 private:
  struct PartLink {
    std::int64_t number;
    int from, to;  ///< numbers in the part, -1 outside of it
    int slot;      ///< of the block of both, among the lower number's
    Pose2 error;
    double turn_x, turn_y;  ///< derivatives of the error of place by the source's heading
    double weight;          ///< less than 1 for a loop far off
  };

  int row(std::int64_t node) const { return map_.rows[static_cast<std::size_t>(node)]; }
  void collect_links();
  void order_nodes();
  void lay_out();
  void add_gradient(const PartLink& link, double place, double rotation, Vector& gradient) const;
  void add_blocks(const PartLink& link, double place, double rotation, double* values) const;
  int column(int number, int axis) const;
  void shape(Matrix& hessian) const;

  MapArrays& map_;
  std::vector<std::int64_t> nodes_;
  std::vector<PartLink> links_;
  std::vector<int> first_;  ///< of each number, where its higher neighbours begin
  std::vector<int> beside_;
};

}  // namespace fusionslam::detail
