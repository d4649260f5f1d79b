// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Exact distances, and the fast float filters that say for which rows they are worth computing.
//
// A filter's rounding differs between instruction sets; its error is bounded, and whatever might
// be among the nearest passes it. So the results, which are exact distances, do not differ.
#pragma once

#include <cstddef>
#include <cstdint>

#include "../detail/simd.hpp"

namespace fusionslam::detail {

/// Squared L2 distance of two float vectors, accumulated in double.
double squared_distance(const float* a, const float* b, std::size_t size);

/// Squared norm, accumulated in double.
double squared_norm(const float* a, std::size_t size);

/// True if every value's magnitude is at most `limit`; false for NaN.
bool all_within(const float* a, std::size_t size, float limit);

/// Rows of one tile of the batch filter, and the most that any level takes.
struct TileShape {
  std::size_t queries;
  std::size_t rows;
};
constexpr TileShape largest_tile{14, 32};

/// The filters for one instruction set.
struct DistanceKernels {
  /// squares[i] is the squared distance of the query and row i of `count` contiguous ones, or if
  /// that is above `limit`, maybe a part of it that is above as well. See direct_error().
  void (*squares)(const float* query, const float* rows, std::size_t count, std::size_t dimension,
                  float limit, float* squares);

  TileShape tile;
  /// bounds[q * tile.rows + r] = row_terms[r] - 2 * dot product, of panels packed with
  /// pack_panel(); bit r of hits[q] tells whether that is not above limits[q]. See tile_error().
  void (*bounds)(const float* query_panel, const float* row_panel, std::size_t dimension,
                 const float* row_terms, const float* limits, float* bounds, std::uint32_t* hits);
};

DistanceKernels distance_kernels(SimdLevel level);

/// panel[c * width + r] = rows[r * dimension + c] - center[c], and 0 from row `count` on.
void pack_panel(const float* rows, std::size_t count, std::size_t dimension, const float* center,
                std::size_t width, float* panel);

/// Bounds of the rounding errors of DistanceKernels on every level, also where denormals are
/// flushed to zero: an error is at most `relative` times the quantity named, plus `absolute`.
struct ErrorBound {
  double relative;
  double absolute;
};
/// Of a square: relative to it.
ErrorBound direct_error(std::size_t dimension);
/// Of |p|^2 + |q|^2 - 2 dot(p, q) as a squared distance before centring: relative to |p|^2 + |q|^2.
ErrorBound tile_error(std::size_t dimension);

}  // namespace fusionslam::detail
