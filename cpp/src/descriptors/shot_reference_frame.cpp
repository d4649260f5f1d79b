// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "shot_reference_frame.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <vector>

#include "../detail/parallel.hpp"

namespace fusionslam::detail {
namespace {

/// Results of `work(begin, end)` for each chunk of the points.
template <class Result, class Work>
std::vector<Result> for_chunks(std::size_t size, int threads, Work&& work) {
  std::vector<Result> results((size + shot_chunk - 1) / shot_chunk);
  parallel_for(results.size(), threads, [&](std::size_t i) {
    results[i] = work(i * shot_chunk, std::min((i + 1) * shot_chunk, size));
  });
  return results;
}

ShotScatter scatter(const ShotSupport& support, int threads, const ShotKernels& kernels) {
  ShotScatter total{};
  for (const ShotScatter& part :
       for_chunks<ShotScatter>(support.size, threads, [&](std::size_t begin, std::size_t end) {
         return kernels.scatter(support, begin, end);
       })) {
    for (std::size_t i = 0; i < 6; ++i) total.sums[i] += part.sums[i];
    total.weight += part.weight;
    total.count += part.count;
  }
  return total;
}

ShotSides sides(const ShotSupport& support, int threads, const ShotKernels& kernels,
                const Eigen::Vector3d& first, const Eigen::Vector3d& second) {
  ShotSides total{0, 0};
  for (const ShotSides& part :
       for_chunks<ShotSides>(support.size, threads, [&](std::size_t begin, std::size_t end) {
         return kernels.sides(support, begin, end, first.data(), second.data());
       })) {
    total.first += part.first;
    total.second += part.second;
  }
  return total;
}

struct Offset {
  float squared;
  std::size_t index;
  Eigen::Vector3f offset;
  bool operator<(const Offset& other) const {
    return squared < other.squared || (squared == other.squared && index < other.index);
  }
};

/// The offsets of the five points of middle distance.
std::array<Eigen::Vector3d, 5> middle_offsets(const ShotSupport& support) {
  const Eigen::Vector3f center(support.center[0], support.center[1], support.center[2]);
  std::vector<Offset> offsets;
  for (std::size_t i = 0; i < support.size; ++i) {
    const Eigen::Vector3f d = Eigen::Vector3f(support.x[i], support.y[i], support.z[i]) - center;
    const float squared = d.x() * d.x() + d.y() * d.y() + d.z() * d.z();
    if (squared < support.squared_radius && !d.isZero(0)) offsets.push_back({squared, i, d});
  }
  const auto first = offsets.begin() + static_cast<std::ptrdiff_t>(offsets.size() / 2) - 2;
  std::nth_element(offsets.begin(), first, offsets.end());
  std::partial_sort(first, first + 5, offsets.end());
  std::array<Eigen::Vector3d, 5> result;
  for (std::size_t i = 0; i < 5; ++i)
    result[i] = first[static_cast<std::ptrdiff_t>(i)].offset.cast<double>();
  return result;
}

/// Turns the axis to where most points are; a draw is decided by the five of middle distance.
void turn(Eigen::Vector3d& axis, std::size_t ahead, std::size_t count, const ShotSupport& support) {
  bool keep = 2 * ahead > count;
  if (2 * ahead == count) {
    const auto middle = middle_offsets(support);
    keep = std::count_if(middle.begin(), middle.end(),
                         [&](const Eigen::Vector3d& d) { return d.dot(axis) > 0; }) > 2;
  }
  if (!keep) axis = -axis;
}

}  // namespace

std::optional<ShotFrame> shot_reference_frame(const ShotSupport& support, int threads,
                                              const ShotKernels& kernels) {
  const ShotScatter sum = scatter(support, threads, kernels);
  if (sum.count < 5) return std::nullopt;
  Eigen::Matrix3d covariance;
  covariance << sum.sums[0], sum.sums[1], sum.sums[2], sum.sums[1], sum.sums[3], sum.sums[4],
      sum.sums[2], sum.sums[4], sum.sums[5];
  covariance /= sum.weight;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  if (!solver.eigenvalues().allFinite()) return std::nullopt;
  Eigen::Vector3d x_axis = solver.eigenvectors().col(2), z_axis = solver.eigenvectors().col(0);
  const ShotSides ahead = sides(support, threads, kernels, x_axis, z_axis);
  turn(x_axis, ahead.first, sum.count, support);
  turn(z_axis, ahead.second, sum.count, support);
  const Eigen::Vector3f x = x_axis.cast<float>(), z = z_axis.cast<float>(), y = z.cross(x);
  return ShotFrame{{x[0], x[1], x[2]}, {y[0], y[1], y[2]}, {z[0], z[1], z[2]}};
}

}  // namespace fusionslam::detail
