// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Each link depends on the previous one, so there is nothing to vectorise; sines dominate the time.
// Small corrections rotate them instead of computing them again.
#include "sweeps_kernel.hpp"

#include <cmath>
#include <numbers>

namespace fusionslam::detail {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double small_turn = 0.05;  // the series' next terms are below 1e-17 here

double wrap_near(double angle) {
  while (angle > pi) angle -= 2 * pi;
  while (angle <= -pi) angle += 2 * pi;
  return angle;
}

void turn(SweptNode& node, double sine, double cosine, double angle) {
  const double c = node.cosine * cosine - node.sine * sine;
  node.sine = node.sine * cosine + node.cosine * sine;
  node.cosine = c;
  node.heading = wrap_near(node.heading + angle);
}

}  // namespace

SweptSquares sweep(SweptNode* nodes, const SweptLink* links, std::size_t count, double part) {
  SweptSquares squares;
  for (const SweptLink* link = links; link != links + count; ++link) {
    SweptNode &from = nodes[link->source], &to = nodes[link->target];
    const double error_x = to.x - from.x - (from.cosine * link->forward - from.sine * link->left);
    const double error_y = to.y - from.y - (from.sine * link->forward + from.cosine * link->left);
    const double error = wrap_near(to.heading - from.heading - link->facing);
    squares.place += error_x * error_x + error_y * error_y;
    squares.rotation += error * error;
    from.x += error_x * part, from.y += error_y * part;
    to.x -= error_x * part, to.y -= error_y * part;
    const double t = error * part, t2 = t * t;
    double sine, cosine;
    if (std::abs(t) < small_turn) {
      sine = t * (1 - t2 / 6 * (1 - t2 / 20 * (1 - t2 / 42)));
      cosine = 1 - t2 / 2 * (1 - t2 / 12 * (1 - t2 / 30 * (1 - t2 / 56)));
    } else {
      sine = std::sin(t), cosine = std::cos(t);
    }
    turn(from, sine, cosine, t);
    turn(to, -sine, cosine, -t);
  }
  return squares;
}

}  // namespace fusionslam::detail
