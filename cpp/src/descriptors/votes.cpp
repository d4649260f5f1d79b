// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "votes.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <mutex>
#include <numbers>

#include "../detail/interrupt.hpp"
#include "../detail/parallel.hpp"
#include "m2dp_fast_kernel.hpp"

namespace fusionslam::detail {
namespace {

using std::numbers::pi;

RawPoints part(RawPoints points, std::size_t begin, std::size_t count) {
  return {points.data + begin * points.stride, points.stride, count};
}

/// Points a work item: whole blocks, few enough for 16-bit votes and for all threads to have some.
std::size_t chunk_size(std::size_t points, int threads) {
  const std::size_t workers = thread_count(threads);
  if (workers == 1) return fast_chunk;
  const std::size_t blocks = (points / (4 * workers) + fast_block - 1) / fast_block;
  return std::clamp(blocks * fast_block, 8 * fast_block, fast_chunk);
}

/// Calls count(begin, size, votes) for each chunk, and add(votes) for one after the other.
template <class Vote, class Count, class Add>
void count_chunks(std::size_t points, std::size_t votes_size, int threads, Count&& count,
                  Add&& add) {
  std::mutex adding;
  const std::size_t chunk = chunk_size(points, threads);
  parallel_for((points + chunk - 1) / chunk, threads, [&](std::size_t i) {
    std::vector<Vote> votes(votes_size);
    count(i * chunk, std::min(chunk, points - i * chunk), votes.data());
    const std::lock_guard lock(adding);
    add(votes.data());
  });
}

// The papers' sizes.

std::vector<FastPlane> fast_planes(const std::vector<KernelPlane>& planes) {
  std::vector<FastPlane> result;
  for (const KernelPlane& plane : planes)
    result.push_back({{-static_cast<float>(plane.x_axis[0]), -static_cast<float>(plane.x_axis[1]),
                       -static_cast<float>(plane.x_axis[2])},
                      {static_cast<float>(plane.y_axis[1]), static_cast<float>(plane.y_axis[2])}});
  result.resize((planes.size() + fast_group - 1) / fast_group * fast_group);
  return result;
}

/// A point in the very middle, which has no direction, counts at angle 0 on every plane.
void nudge_middle(FastBlock& block) {
  for (std::size_t i = 0; i < block.size; ++i)
    if (block.x[i] == 0 && block.y[i] == 0 && block.z[i] == 0) block.x[i] = 1e-20F;
}

void load_colors(const ColorBinner& colors, std::size_t begin, FastBlock& block) {
  std::uint8_t bins[3 * fast_block];
  colors.bins(begin, block.size, bins);
  std::memset(block.color_rows, 0, block.size * fast_color_row);
  for (std::size_t i = 0; i < block.size; ++i)
    for (std::size_t c = 0; c < 3; ++c)
      block.color_rows[i][fast_sectors + c * fast_color_bins + bins[3 * i + c]] = 1;
}

struct FastCounter {
  const VoteTask& task;
  std::vector<FastPlane> planes;
  FastKernel kernel;
  MomentsKernel moments;
  std::size_t plane_size;  ///< votes a plane

  FastCounter(const VoteTask& counted, const std::vector<KernelPlane>& all, SimdLevel level)
      : task(counted),
        planes(fast_planes(all)),
        kernel(fast_kernel(level)),
        moments(moments_kernel(level)),
        plane_size(fast_rings * (counted.colors ? fast_color_row : fast_shape_row)) {}

  void operator()(std::size_t begin, std::size_t count, std::uint16_t* votes) const {
    const auto block = std::make_unique<FastBlock>();
    const auto add = task.colors ? kernel.color : kernel.shape;
    for (std::size_t first = begin; first < begin + count; first += fast_block) {
      check_interrupt();
      block->size = std::min(fast_block, begin + count - first);
      moments.transform(part(task.points, first, block->size), task.frame, block->x, block->y,
                        block->z);
      nudge_middle(*block);
      if (task.colors) load_colors(*task.colors, first, *block);
      for (std::size_t p = 0; p < planes.size(); p += fast_group)
        add(*block, planes.data() + p, votes + p * plane_size);
    }
  }
};

/// Adds lines of sectors and colours to the columns of a signature.
void add_to_columns(const std::uint16_t* votes, int row_size, int color_bins, double* columns) {
  int codes[fast_sectors];
  for (int sector = 0; sector < fast_sectors; ++sector) codes[sector] = fast_sector_code(sector);
  for (int ring = 0; ring < fast_rings; ++ring)
    for (const int code : codes) *columns++ += votes[ring * row_size + code];
  if (row_size == fast_shape_row) return;
  for (int channel = 0; channel < 3; ++channel)
    for (int ring = 0; ring < fast_rings; ++ring) {
      const std::uint16_t* colors =
          votes + ring * row_size + fast_sectors + channel * fast_color_bins;
      for (int bin = 0; bin < color_bins; ++bin) *columns++ += colors[bin];
    }
}

void count_fast(const VoteTask& task, const std::vector<KernelPlane>& planes,
                const M2dpConfig& config, SimdLevel level, int threads, Signature& result) {
  const FastCounter counter(task, planes, level);
  const int row_size = task.colors ? fast_color_row : fast_shape_row;
  const auto add = [&](const std::uint16_t* votes) {
    for (std::size_t p = 0; p < planes.size(); ++p)
      add_to_columns(votes + p * counter.plane_size, row_size, config.color_bins,
                     result.values.data() + p * static_cast<std::size_t>(result.columns));
  };
  count_chunks<std::uint16_t>(task.points.size, counter.planes.size() * counter.plane_size, threads,
                              counter, add);
}

// Any sizes.

/// Edges of rings and sectors in units of the outer radius; owns what KernelBins points to.
struct Bins {
  std::vector<double> ring_edges, sector_cosines, sector_sines;
  KernelBins kernel{};

  explicit Bins(const M2dpConfig& config) {
    for (int i = 1; i < config.rings; ++i)
      ring_edges.push_back(std::pow(static_cast<double>(i) / config.rings, 4));
    for (int i = 0; i < config.sectors; ++i) {
      const double angle = -pi + 2 * pi * i / config.sectors;
      sector_cosines.push_back(std::cos(angle));
      sector_sines.push_back(std::sin(angle));
    }
    const int first_upper = (config.sectors + 1) / 2;
    kernel = {ring_edges.data(), sector_cosines.data(), sector_sines.data(), config.rings,
              config.sectors,    first_upper,           config.sectors / 2,  config.color_bins};
  }
};

void transform(RawPoints points, const KernelFrame& f, double* x, double* y, double* z) {
  for (std::size_t i = 0; i < points.size; ++i) {
    const float* p = points.data + i * points.stride;
    const double d[3] = {p[0] - f.origin[0], p[1] - f.origin[1], p[2] - f.origin[2]};
    double* q[3] = {x + i, y + i, z + i};
    for (int row = 0; row < 3; ++row)
      *q[row] = f.rows[row][0] * d[0] + f.rows[row][1] * d[1] + f.rows[row][2] * d[2];
  }
}

struct AnyCounter {
  const VoteTask& task;
  const std::vector<KernelPlane>& planes;
  Bins bins;
  std::size_t columns;

  void operator()(std::size_t begin, std::size_t count, std::uint32_t* votes) const {
    double x[fast_block], y[fast_block], z[fast_block];
    std::uint8_t colors[3 * fast_block];
    for (std::size_t first = begin; first < begin + count; first += fast_block) {
      check_interrupt();
      const std::size_t size = std::min(fast_block, begin + count - first);
      transform(part(task.points, first, size), task.frame, x, y, z);
      if (task.colors) task.colors->bins(first, size, colors);
      const KernelCloud cloud{x, y, z, task.colors ? colors : nullptr, size};
      for (std::size_t p = 0; p < planes.size(); ++p)
        detail::count_votes(cloud, planes[p], bins.kernel, votes + p * columns);
    }
  }
};

void count_any(const VoteTask& task, const std::vector<KernelPlane>& planes,
               const M2dpConfig& config, int threads, Signature& result) {
  const AnyCounter counter{task, planes, Bins(config), static_cast<std::size_t>(result.columns)};
  const auto add = [&](const std::uint32_t* votes) {
    for (std::size_t i = 0; i < result.values.size(); ++i) result.values[i] += votes[i];
  };
  count_chunks<std::uint32_t>(task.points.size, result.values.size(), threads, counter, add);
}

bool is_degenerate(const KernelPlane& plane) {
  const auto is_zero = [](double value) { return value == 0; };
  return std::all_of(plane.x_axis, plane.x_axis + 3, is_zero);
}

}  // namespace

bool is_fast_case(const M2dpConfig& config, const std::vector<KernelPlane>& planes) {
  return config.rings == fast_rings && config.sectors == fast_sectors &&
         config.color_bins <= fast_color_bins &&
         std::none_of(planes.begin(), planes.end(), is_degenerate);
}

Signature count_votes(const VoteTask& task, const std::vector<KernelPlane>& planes,
                      const M2dpConfig& config, SimdLevel level, int threads) {
  const int columns = config.shape_columns() + (task.colors ? config.color_columns() : 0);
  Signature result{static_cast<int>(planes.size()), columns, {}};
  result.values.resize(planes.size() * static_cast<std::size_t>(columns));
  if (is_fast_case(config, planes))
    count_fast(task, planes, config, level, threads, result);
  else
    count_any(task, planes, config, threads, result);
  return result;
}

}  // namespace fusionslam::detail
