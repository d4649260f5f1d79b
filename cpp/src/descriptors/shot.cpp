// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// SHOT and CSHOT as global descriptors: one keypoint, the centroid, supported by the whole cloud.
#include <algorithm>
#include <array>
#include <cmath>

#include "../detail/checks.hpp"
#include "../detail/parallel.hpp"
#include "cloud_axes.hpp"
#include "fusionslam/descriptors.hpp"
#include "fusionslam/errors.hpp"
#include "lab_distance.hpp"
#include "shot_reference_frame.hpp"
#include "surface_normals.hpp"

namespace fusionslam::detail {
namespace {

Normals compute_normals(PointsView points, std::optional<double> normal_radius, int threads,
                        const char* name) {
  check_points(points, 5, name);
  // Points on one line have normals by rounding only.
  principal_axes(points, AxisSigns::largest_entry);
  if (normal_radius) check_normal_radius(*normal_radius);
  const PointBlocks cloud(points, threads, simd_level());
  const double radius = normal_radius ? *normal_radius : 5 * resolution(cloud, threads);
  if (!normal_radius && !(radius > 0))
    throw DataError("each point of the cloud lies on another one: it has no resolution");
  Normals normals = surface_normals(cloud, radius, threads);
  if (normals.indices.size() < 5)
    throw DataError(std::string(name) +
                    " needs at least 5 points with a normal; those that have 3 neighbours within " +
                    std::to_string(radius) + " m: " + std::to_string(normals.indices.size()));
  return normals;
}

/// Below it, in metres, products of coordinates lose digits to the smallest floats.
constexpr double least_radius = 1e-12;

/// The points that have a normal, a coordinate at a time. 28 bytes a point.
struct Surface {
  std::vector<float> x, y, z, normal_x, normal_y, normal_z;
  std::vector<float> colors;  ///< distances to the mean colour; empty for SHOT

  explicit Surface(std::size_t size)
      : x(size), y(size), z(size), normal_x(size), normal_y(size), normal_z(size) {}
};

Surface surface(PointsView points, const Normals& normals) {
  Surface result(normals.indices.size());
  for (std::size_t i = 0; i < normals.indices.size(); ++i) {
    const float* point = points[static_cast<std::size_t>(normals.indices[i])];
    result.x[i] = point[0];
    result.y[i] = point[1];
    result.z[i] = point[2];
    result.normal_x[i] = normals.normals[3 * i];
    result.normal_y[i] = normals.normals[3 * i + 1];
    result.normal_z[i] = normals.normals[3 * i + 2];
  }
  return result;
}

using Center = std::array<float, 3>;

/// The mean of the points, added up in `Sum`.
template <class Sum>
Center mean(const Surface& surface) {
  Center result;
  const std::vector<float>* columns[] = {&surface.x, &surface.y, &surface.z};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    Sum sum = 0;
    for (const float value : *columns[axis]) sum += value;
    result[axis] = static_cast<float>(sum / static_cast<Sum>(surface.x.size()));
  }
  return result;
}

float squared_distance(float x, float y, float z, const Center& center) {
  const float dx = x - center[0], dy = y - center[1], dz = z - center[2];
  return dx * dx + dy * dy + dz * dz;
}

float farthest(const Surface& surface, const Center& center) {
  float largest = 0;
  for (std::size_t i = 0; i < surface.x.size(); ++i)
    largest = std::max(largest, squared_distance(surface.x[i], surface.y[i], surface.z[i], center));
  return std::sqrt(largest);
}

/// PCL's centroid, a sum of floats. Far from the origin, where that can be metres off, the exact
/// mean instead.
Center centroid(const Surface& surface) {
  const Center exact = mean<double>(surface), summed = mean<float>(surface);
  const float error = std::sqrt(squared_distance(summed[0], summed[1], summed[2], exact));
  return error <= 1e-4F * farthest(surface, exact) ? summed : exact;
}

std::array<std::uint8_t, 3> color(ColorsView colors, std::int64_t index) {
  const auto i = static_cast<std::size_t>(index);
  return {colors.at(i, 0), colors.at(i, 1), colors.at(i, 2)};
}

std::vector<float> color_distances(ColorsView colors, const std::vector<std::int64_t>& indices,
                                   int threads) {
  std::array<std::uint64_t, 3> sums{};
  for (const std::int64_t index : indices) {
    const auto c = color(colors, index);
    for (std::size_t k = 0; k < 3; ++k) sums[k] += c[k];
  }
  std::array<std::uint8_t, 3> mean_color{};
  for (std::size_t k = 0; k < 3; ++k)
    mean_color[k] = static_cast<std::uint8_t>(sums[k] / indices.size());
  const LabDistance distance(mean_color);
  std::vector<float> result(indices.size());
  parallel_for((indices.size() + shot_chunk - 1) / shot_chunk, threads, [&](std::size_t c) {
    const std::size_t end = std::min((c + 1) * shot_chunk, indices.size());
    for (std::size_t i = c * shot_chunk; i < end; ++i)
      result[i] = distance(color(colors, indices[i]));
  });
  return result;
}

/// The keypoint is the centroid, its radius the distance of the farthest point. Both are floats, as
/// in PCL: the rounding of the radius decides whether the farthest point is nearer than it.
ShotSupport support(const Surface& surface) {
  const Center center = centroid(surface);
  const double radius = farthest(surface, center);
  return {surface.x.data(),
          surface.y.data(),
          surface.z.data(),
          surface.normal_x.data(),
          surface.normal_y.data(),
          surface.normal_z.data(),
          surface.colors.empty() ? nullptr : surface.colors.data(),
          surface.x.size(),
          {center[0], center[1], center[2]},
          radius,
          static_cast<float>(radius * radius)};
}

/// All votes, added up chunk by chunk; each chunk of 4,096 points needs 11 kB for its own.
std::vector<double> histogram(const ShotSupport& support, const ShotFrame& frame, int threads,
                              const ShotKernels& kernels) {
  const std::size_t size =
      static_cast<std::size_t>(shot_shape_size + (support.color ? shot_color_size : 0));
  const std::size_t chunks = (support.size + shot_chunk - 1) / shot_chunk;
  std::vector<double> parts(chunks * size);
  parallel_for(chunks, threads, [&](std::size_t i) {
    kernels.vote(support, i * shot_chunk, std::min((i + 1) * shot_chunk, support.size), frame,
                 parts.data() + i * size);
  });
  std::vector<double> result(size);
  for (std::size_t i = 0; i < parts.size(); ++i) result[i % size] += parts[i];
  return result;
}

std::vector<float> normalize(const std::vector<double>& histogram) {
  double squared = 0;
  for (const double value : histogram) squared += value * value;
  std::vector<float> result;
  result.reserve(histogram.size());
  for (const double value : histogram)
    result.push_back(static_cast<float>(value / std::sqrt(squared)));
  return result;
}

/// SHOT, or with colours CSHOT, at the mean of the points that have a normal, all of which support
/// it. Throws DataError if these are equal or have no local frame.
std::vector<float> global_shot(PointsView points, ColorsView colors, const Normals& normals,
                               int threads) {
  const char* name = colors.data ? "CSHOT" : "SHOT";
  Surface all = surface(points, normals);
  if (colors.data) all.colors = color_distances(colors, normals.indices, threads);
  const ShotSupport seen = support(all);
  if (!(seen.radius > 0))
    throw DataError(std::string("all points are equal, ") + name + " is undefined");
  if (!(seen.radius >= least_radius))
    throw DataError("all points lie within 1e-12 m of their mean: " + std::string(name) +
                    " in single precision would be wrong (a wrong unit?)");
  const ShotKernels kernels = shot_kernels(simd_level());
  const auto frame = shot_reference_frame(seen, threads, kernels);
  if (!frame) throw DataError(std::string(name) + " has no local reference frame on this cloud");
  return normalize(histogram(seen, *frame, threads, kernels));
}

}  // namespace
}  // namespace fusionslam::detail

namespace fusionslam {

std::vector<float> shot(PointsView points, std::optional<double> normal_radius, int threads) {
  return detail::global_shot(
      points, {}, detail::compute_normals(points, normal_radius, threads, "SHOT"), threads);
}

std::vector<float> cshot(PointsView points, ColorsView colors, std::optional<double> normal_radius,
                         int threads) {
  detail::check_colors(points, colors);
  return detail::global_shot(
      points, colors, detail::compute_normals(points, normal_radius, threads, "CSHOT"), threads);
}

std::vector<float> shot_at_centroid(PointsView points, PointsView normals, ColorsView colors,
                                    int threads) {
  detail::check_points(points, 5, "SHOT");
  if (normals.size != points.size)
    throw ShapeError("normals has " + detail::count_text(normals.size, "row") + ", points has " +
                     std::to_string(points.size));
  if (colors.data) detail::check_colors(points, colors);
  Normals given;
  given.normals.reserve(3 * points.size);
  for (std::size_t i = 0; i < normals.size; ++i) {
    if (!detail::is_finite(normals[i]))
      throw DataError("normal " + std::to_string(i) + " is not finite");
    given.normals.insert(given.normals.end(), normals[i], normals[i] + 3);
    given.indices.push_back(static_cast<std::int64_t>(i));
  }
  return detail::global_shot(points, colors, given, threads);
}

}  // namespace fusionslam
