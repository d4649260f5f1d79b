// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <cstddef>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/mapping.hpp"

namespace fusionslam {
namespace {

constexpr Pose3 identity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
constexpr Pose3 metre{1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

PoseCovariance diagonal(double variance_m, double variance_rad) {
  PoseCovariance covariance{};
  for (std::size_t i = 0; i < 6; ++i) covariance[7 * i] = i < 3 ? variance_m : variance_rad;
  return covariance;
}

TEST_CASE("errors of rotation move the end of a straight way by their distance from it") {
  OdometryTree tree;
  tree.add_root(identity);
  for (int i = 0; i < 4; ++i) tree.add(i, metre, diagonal(0.01, 0.0001), false);
  const PoseCovariance drift = tree.drift(0, 4);
  CHECK(drift[0] == doctest::Approx(0.04));                          // along the way
  CHECK(drift[7] == doctest::Approx(0.04 + 0.0001 * (9 + 4 + 1)));   // across
  CHECK(drift[35] == doctest::Approx(0.0004));                       // heading
  CHECK(drift[6 * 1 + 5] == doctest::Approx(0.0001 * (3 + 2 + 1)));  // both
  CHECK(tree.drift(2, 2)[0] == doctest::Approx(0));
  const DriftFit fit = tree.fit(0, 4, {0.3, 0, 0, 0, 0, 0.1}, diagonal(0.05, 0.0005), 3);
  CHECK(fit.error_m == doctest::Approx(0.3));
  CHECK(fit.allowed_m == doctest::Approx(3 * 0.3));
  CHECK(fit.allowed_rad == doctest::Approx(3 * 0.03));
}

TEST_CASE("nodes that odometry does not connect have no drift between them") {
  OdometryTree tree;
  tree.add_root(identity);
  tree.add_root(identity);
  CHECK_THROWS_AS(tree.drift(0, 1), DataError);
  CHECK_THROWS_AS(tree.drift(0, 2), DataError);
  CHECK_THROWS_AS(tree.add(7, metre, diagonal(1, 1), false), DataError);
}

TEST_CASE("a tree is restored, and impossible states change nothing") {
  OdometryTree tree;
  tree.add_root(identity);
  for (int i = 0; i < 9; ++i) tree.add(i / 2, metre, diagonal(0.01, 0.0001), i % 2 == 1);
  std::vector<Pose3> poses;
  std::vector<PoseCovariance> totals;
  std::vector<std::int64_t> parents;
  for (std::int64_t i = 0; i < tree.size(); ++i) {
    poses.push_back(tree.pose(i));
    totals.push_back(tree.total(i));
    parents.push_back(tree.parent(i));
  }
  OdometryTree copy;
  copy.restore(poses, totals, parents);
  CHECK(copy.drift(7, 9) == tree.drift(7, 9));
  parents[3] = 5;
  CHECK_THROWS_AS(copy.restore(poses, totals, parents), DataError);
  totals.pop_back();
  CHECK_THROWS_AS(copy.restore(poses, totals, parents), DataError);
  CHECK(copy.size() == tree.size());
}

}  // namespace
}  // namespace fusionslam
