// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "turn_search.hpp"

#include <algorithm>
#include <numbers>
#include <string>

#include "../detail/interrupt.hpp"
#include "../detail/parallel.hpp"
#include "fusionslam/errors.hpp"

namespace fusionslam {
namespace detail {

void check_sectors(std::size_t dimension) {
  if (dimension == 0 || dimension % sectors != 0)
    throw ShapeError("a Scan Context has " + std::to_string(dimension) +
                     " values, expected a multiple of " + std::to_string(sectors));
}

std::size_t spectrum_size(std::size_t dimension) {
  return turn_lanes + dimension / sectors * ring_spectrum;
}

void write_spectrum(std::span<const float> descriptor, std::span<float> spectrum) {
  const TurnKernels kernels = turn_kernels(simd_level());
  const std::size_t bins = descriptor.size() / sectors;
  AlignedFloats unit(descriptor.size());
  spectrum[0] = static_cast<float>(kernels.normalize(descriptor.data(), bins, unit.data()));
  kernels.transform(unit.data(), bins, spectrum.data() + turn_lanes);
}

TurnSearch::TurnSearch(std::span<const float> query, std::size_t k)
    : bins_(query.size() / sectors),
      size_((query.size() + turn_lanes - 1) / turn_lanes * turn_lanes),
      kernels_(turn_kernels(simd_level())),
      nearest_(k),
      query_(query.size() + size_),
      row_(size_),
      spectrum_(spectrum_size(query.size())),
      filled_(kernels_.normalize(query.data(), bins_, query_.data())) {
  kernels_.transform(query_.data(), bins_, spectrum_.data() + turn_lanes);
  std::copy_n(query_.begin(), query.size(),
              query_.begin() + static_cast<std::ptrdiff_t>(query.size()));
}

std::pair<double, std::size_t> TurnSearch::compare(const float* row) {
  const std::size_t filled = std::max(filled_, kernels_.normalize(row, bins_, row_.data()));
  float dots[sectors];
  kernels_.dots(query_.data(), row_.data(), bins_, size_, dots);
  const float* best = std::ranges::max_element(dots);
  const double cosine = filled > 0 ? static_cast<double>(*best) / static_cast<double>(filled) : 0;
  return {std::max(0.0, 1 - cosine), static_cast<std::size_t>(best - dots)};
}

double TurnSearch::least_distance(const float* spectrum) const {
  const auto filled = std::max(static_cast<double>(filled_), static_cast<double>(spectrum[0]));
  if (filled == 0) return 1;
  const float most =
      kernels_.correlate(spectrum_.data() + turn_lanes, spectrum + turn_lanes, bins_);
  return 1 - (static_cast<double>(most) + correlation_error(bins_)) / filled;
}

MatchTable search_turns(std::span<const float> queries, std::span<const float> rows,
                        std::size_t dimension, std::optional<std::size_t> window, std::size_t k,
                        int threads) {
  check_sectors(dimension);
  const std::size_t count = queries.size() / dimension;
  const std::size_t row_count = rows.size() / dimension;
  const std::size_t width = spectrum_size(dimension);
  AlignedFloats spectra(row_count * width);
  parallel_for(row_count, threads, [&](std::size_t row) {
    write_spectrum(rows.subspan(row * dimension, dimension),
                   std::span(spectra).subspan(row * width, width));
  });
  MatchTable table{k, std::vector<std::int64_t>(count * k, -1),
                   std::vector<float>(count * k, std::numeric_limits<float>::infinity())};
  parallel_for(count, threads, [&](std::size_t i) {
    const std::size_t query = count - 1 - i;  // those with most candidates first
    TurnSearch search(queries.subspan(query * dimension, dimension), k);
    const std::size_t end = window ? query - std::min(query, *window) : row_count;
    for (std::size_t row = 0; row < end; ++row) {
      if (row % 1024 == 0) check_interrupt();
      search.offer(row, rows.data() + row * dimension, spectra.data() + row * width);
    }
    const auto matches = search.matches();
    for (std::size_t rank = 0; rank < matches.size(); ++rank) {
      table.indices[query * k + rank] = matches[rank].index;
      table.distances[query * k + rank] = matches[rank].distance;
    }
  });
  return table;
}

}  // namespace detail

TurnedMatch compare_scan_contexts(std::span<const float> query, std::span<const float> match) {
  detail::check_sectors(query.size());
  if (match.size() != query.size())
    throw ShapeError("Scan Contexts have " + std::to_string(query.size()) + " and " +
                     std::to_string(match.size()) + " values, expected equal lengths");
  detail::check_values(query, 0);
  detail::check_values(match, 1);
  const auto [distance, turn] = detail::TurnSearch(query, 1).compare(match.data());
  // What the query sees `turn` sectors further left, the match sees ahead.
  double yaw = -2 * std::numbers::pi * static_cast<double>(turn) / detail::sectors;
  if (yaw <= -std::numbers::pi) yaw += 2 * std::numbers::pi;
  return {static_cast<float>(distance), yaw};
}

}  // namespace fusionslam
