// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "fusionslam/ratslam/pose_cells.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "../detail/interrupt.hpp"
#include "fusionslam/errors.hpp"
#include "sheet_kernel.hpp"

namespace fusionslam {
namespace {

using detail::SheetKernels;
using detail::Window;
using Blur = decltype(SheetKernels::blur3);

constexpr std::size_t layers_count = PoseSheet::headings;
constexpr int box = 3;  // cells to each side of the largest one that are decoded
constexpr int smallest = 2 * box + 1, largest = 1000;

/// A Gaussian, 2 reach + 1 wide, scaled to the sum 1.
Window gaussian(int reach, double deviation) {
  Window window{};
  double sum = 0;
  for (int k = -reach; k <= reach; ++k) sum += std::exp(-k * k / (2 * deviation * deviation));
  for (int k = 0; k <= reach; ++k)
    window.weights[k] = std::exp(-k * k / (2 * deviation * deviation)) / sum;
  return window;
}

/// value in [0, period), exactly.
double wrap(double value, double period) {
  double rest = std::fmod(value, period);
  if (rest < 0) rest += period;
  return rest < period ? rest : 0;  // a tiny negative rest is rounded up to the period
}

/// A shift along one axis: whole cells, and the shares that land there and one cell further. The
/// shares of a shift and of the opposite one are exactly each other's, so that a symmetric packet
/// stays symmetric to the last bit.
struct Way {
  std::size_t whole;
  double here, beyond;

  Way(double cells, int period) {
    const double truncated = std::trunc(cells), rest = cells - truncated;
    whole = static_cast<std::size_t>(wrap(rest < 0 ? truncated - 1 : truncated, period));
    here = rest < 0 ? -rest : 1 - rest;
    beyond = rest < 0 ? 1 + rest : rest;
  }
};

/// A layer with `reach` wrapped cells on every side, which makes rows 2 reach longer.
void pad(const double* layer, std::size_t n, std::size_t reach, double* padded) {
  const std::size_t wide = n + 2 * reach;
  for (std::size_t y = 0; y < wide; ++y, padded += wide) {
    const double* row = layer + (y + n - reach) % n * n;
    std::copy_n(row + n - reach, reach, padded);
    std::copy_n(row, n, padded + reach);
    std::copy_n(row, reach, padded + reach + n);
  }
}

/// Layers that hold activity. A packet is in a few of them; the others are 0 and are skipped.
struct Active {
  std::array<bool, layers_count> layers{};

  Active(const double* cells, std::size_t area, const SheetKernels kernels) {
    for (std::size_t th = 0; th < layers_count; ++th)
      layers[th] = kernels.largest(cells + th * area, area) > 0;
  }
  /// True if any layer from first to last does; numbers continue beyond the wrap.
  bool any(std::size_t first, std::size_t last) const {
    for (std::size_t th = first; th <= last; ++th)
      if (layers[th % layers_count]) return true;
    return false;
  }
};

struct Blurring {
  Blur blur;
  Window window;
  std::size_t reach;
};

/// A layer blurred along x, then along y. `padded` has room for two padded layers.
void blur_layer(const double* layer, std::size_t n, const Blurring& by, double* padded,
                double* out) {
  const std::size_t wide = n + 2 * by.reach;
  double* const rows = padded + wide * wide;
  pad(layer, n, by.reach, padded);
  for (std::size_t y = 0; y < wide; ++y)
    by.blur(padded + y * wide + by.reach, 1, n, by.window, rows + y * n);
  by.blur(rows + by.reach * n, n, n * n, by.window, out);
}

/// The wrapped convolution of all cells, one axis after the other. `layers` has room for 2 reach
/// further ones.
void convolve(const double* cells, std::size_t n, const SheetKernels kernels, const Blurring& by,
              double* layers, double* padded, double* out) {
  const std::size_t area = n * n, before = by.reach * area;
  const Active active(cells, area, kernels);
  for (std::size_t th = 0; th < layers_count; ++th) {
    detail::check_interrupt();
    double* const to = layers + before + th * area;
    if (active.layers[th])
      blur_layer(cells + th * area, n, by, padded, to);
    else
      std::fill_n(to, area, 0.0);
  }
  std::copy_n(layers + layers_count * area, before, layers);
  std::copy_n(layers + before, before, layers + before + layers_count * area);
  for (std::size_t th = 0; th < layers_count; ++th)
    if (active.any(th + layers_count - by.reach, th + layers_count + by.reach))
      by.blur(layers + before + th * area, area, area, by.window, out + th * area);
    else
      std::fill_n(out + th * area, area, 0.0);
}

/// A layer moved by whole cells, with a row before the first one and a column before the first.
void pad_shifted(const double* layer, std::size_t n, std::size_t x, std::size_t y, double* padded) {
  for (std::size_t to = 0; to <= n; ++to, padded += n + 1) {
    const double* row = layer + (to + 2 * n - 1 - y) % n * n;
    const std::size_t first = (2 * n - 1 - x) % n;
    std::copy_n(row + first, n - first, padded);
    std::copy_n(row, first + 1, padded + n - first);
  }
}

/// `padded` has room for (n + 1)^2 and n (n + 1) numbers.
void move_layer(const double* layer, std::size_t n, Way x, Way y, const SheetKernels kernels,
                double* padded, double* out) {
  double* const rows = padded + (n + 1) * (n + 1);
  pad_shifted(layer, n, x.whole, y.whole, padded);
  for (std::size_t row = 0; row <= n; ++row) {
    const double* from = padded + row * (n + 1);
    kernels.mix(from + 1, x.here, from, x.beyond, n, rows + row * n);
  }
  kernels.mix(rows + n, y.here, rows, y.beyond, n * n, out);
}

/// Circular mean of the sums over seven neighbouring cells, the first of which is `first`. Cells
/// count from 1, as in the reference run: its start comes out just below 10, and the cell that a
/// view injects into, the floor of it, is the one before.
double mean_place(const std::array<double, 2 * box + 1>& sums, std::size_t first, int period) {
  double sine = 0, cosine = 0;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const auto cell = static_cast<double>((first + i) % static_cast<std::size_t>(period) + 1);
    const double angle = cell * 2 * std::numbers::pi / period;
    sine += sums[i] * std::sin(angle);
    cosine += sums[i] * std::cos(angle);
  }
  return wrap(std::atan2(sine, cosine) * period / (2 * std::numbers::pi) - 1, period);
}

void check_activity(std::span<const double> activity, std::size_t expected) {
  if (activity.size() != expected)
    throw ShapeError("the activity has " + std::to_string(activity.size()) + " cells, expected " +
                     std::to_string(expected));
  double sum = 0;
  for (const double value : activity) {
    if (!(value >= 0 && std::isfinite(value)))
      throw DataError("a cell's activity is " + std::to_string(value) +
                      ", expected a finite number, 0 or more");
    sum += value;
  }
  if (!(sum > 0 && std::isfinite(sum)))
    throw DataError("the activity of all cells is " + std::to_string(sum) +
                    ", expected a finite number over 0");
}

void check_ways(std::span<const double> x, std::span<const double> y, double layers) {
  if (x.size() != layers_count || y.size() != layers_count)
    throw ShapeError("ways of " + std::to_string(x.size()) + " and " + std::to_string(y.size()) +
                     " layers, expected " + std::to_string(layers_count));
  const auto finite = [](double value) { return std::isfinite(value); };
  if (!std::all_of(x.begin(), x.end(), finite) || !std::all_of(y.begin(), y.end(), finite) ||
      !finite(layers))
    throw DataError("a way on the sheet of pose cells is not finite");
}

}  // namespace

PoseSheet::PoseSheet(int size) : size_(size) {
  if (size < smallest || size > largest)
    throw ConfigError("pose_cells.size is " + std::to_string(size) + ", expected " +
                      std::to_string(smallest) + " to " + std::to_string(largest));
  const auto n = static_cast<std::size_t>(size), wide = n + 2 * Window::reach;
  cells_.resize(layers_count * n * n);
  next_.resize(cells_.size());
  blurred_.resize(cells_.size());
  layers_.resize((layers_count + 2 * Window::reach) * n * n);
  padded_.resize(2 * wide * wide);
  cells_[(layers_count / 2 * n + n / 2) * n + n / 2] = 1;
}

std::size_t PoseSheet::layer_size() const {
  return static_cast<std::size_t>(size_) * static_cast<std::size_t>(size_);
}

void PoseSheet::assign(std::span<const double> activity) {
  check_activity(activity, cells_.size());
  std::copy(activity.begin(), activity.end(), cells_.begin());
}

void PoseSheet::settle(double global_inhibition) {
  const SheetKernels kernels = detail::sheet_kernels(simd_level());
  static const Window excitation = gaussian(3, 1), inhibition = gaussian(2, 2);
  const auto n = static_cast<std::size_t>(size_);
  convolve(cells_.data(), n, kernels, {kernels.blur3, excitation, 3}, layers_.data(),
           padded_.data(), blurred_.data());
  convolve(blurred_.data(), n, kernels, {kernels.blur2, inhibition, 2}, layers_.data(),
           padded_.data(), next_.data());
  // Written to `layers_`: `cells_` stay unchanged until it is known that activity is left.
  const double sum = kernels.inhibit(blurred_.data(), next_.data(), global_inhibition,
                                     cells_.size(), layers_.data());
  // Less than this could not be scaled to 1.
  if (!(sum >= std::numeric_limits<double>::min() && std::isfinite(sum)))
    throw ConfigError("pose_cells.global_inhibition " + std::to_string(global_inhibition) +
                      " leaves no cell active");
  kernels.scale(1 / sum, cells_.size(), layers_.data());
  std::copy_n(layers_.data(), cells_.size(), cells_.data());
}

void PoseSheet::move(std::span<const double> x, std::span<const double> y, double layers) {
  check_ways(x, y, layers);
  const SheetKernels kernels = detail::sheet_kernels(simd_level());
  const auto n = static_cast<std::size_t>(size_), area = layer_size();
  const Active active(cells_.data(), area, kernels);
  for (std::size_t th = 0; th < layers_count; ++th) {
    detail::check_interrupt();
    if (active.layers[th])
      move_layer(cells_.data() + th * area, n, {x[th], size_}, {y[th], size_}, kernels,
                 padded_.data(), next_.data() + th * area);
    else
      std::fill_n(next_.data() + th * area, area, 0.0);
  }
  const Way turn(layers, headings);
  for (std::size_t th = 0; th < layers_count; ++th) {
    const std::size_t from = (th + layers_count - turn.whole) % layers_count;
    const std::size_t before = (from + layers_count - 1) % layers_count;
    if (!active.layers[from] && !active.layers[before]) {
      std::fill_n(cells_.data() + th * area, area, 0.0);
      continue;
    }
    kernels.mix(next_.data() + from * area, turn.here, next_.data() + before * area, turn.beyond,
                area, cells_.data() + th * area);
  }
}

void PoseSheet::inject(const SheetPlace& place, double energy) {
  if (!(energy >= 0) || !std::isfinite(energy + place.x + place.y + place.th))
    throw DataError("energy " + std::to_string(energy) + " at " + std::to_string(place.x) + ", " +
                    std::to_string(place.y) + ", " + std::to_string(place.th) +
                    ": expected finite numbers and energy of 0 or more");
  const auto n = static_cast<std::size_t>(size_);
  const Way x(place.x, size_), y(place.y, size_), th(place.th, headings);
  const auto share = [](const Way& way, std::size_t next) { return next ? way.beyond : way.here; };
  for (std::size_t corner = 0; corner < 8; ++corner) {
    const std::size_t k = corner & 1, j = corner >> 1 & 1, i = corner >> 2;
    const std::size_t layer = (th.whole + i) % layers_count;
    const std::size_t row = (y.whole + j) % n, column = (x.whole + k) % n;
    cells_[(layer * n + row) * n + column] += energy * share(th, i) * share(y, j) * share(x, k);
  }
}

SheetPlace PoseSheet::decode() const {
  const SheetKernels kernels = detail::sheet_kernels(simd_level());
  const auto n = static_cast<std::size_t>(size_);
  const double most = kernels.largest(cells_.data(), cells_.size());
  const auto top =
      static_cast<std::size_t>(std::find(cells_.begin(), cells_.end(), most) - cells_.begin());
  // The first cells of the box, on each axis.
  const std::size_t th = (top / (n * n) + layers_count - box) % layers_count;
  const std::size_t y = (top / n % n + n - box) % n, x = (top % n + n - box) % n;
  std::array<double, 2 * box + 1> along_th{}, along_y{}, along_x{};
  for (std::size_t i = 0; i < along_th.size(); ++i)
    for (std::size_t j = 0; j < along_y.size(); ++j)
      for (std::size_t k = 0; k < along_x.size(); ++k) {
        const double value = cells_[((th + i) % layers_count * n + (y + j) % n) * n + (x + k) % n];
        along_th[i] += value;
        along_y[j] += value;
        along_x[k] += value;
      }
  return {mean_place(along_x, x, size_), mean_place(along_y, y, size_),
          mean_place(along_th, th, headings)};
}

}  // namespace fusionslam
