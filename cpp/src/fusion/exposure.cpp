// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "exposure.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fusionslam::detail {
namespace {

/// Values outside are noise, or brighter than the camera could show.
constexpr int darkest = 16, brightest = 250;
constexpr std::size_t fewest = 30;
constexpr double largest_gain = 2;
/// Logarithms and gains are rounded to a 4096th: std::log and std::exp may differ in their last bit
/// from one machine to the next.
constexpr double unit = 4096;

std::array<std::int32_t, 256> make_logarithms() {
  std::array<std::int32_t, 256> logarithms{};
  for (std::size_t value = 1; value < logarithms.size(); ++value)
    logarithms[value] =
        static_cast<std::int32_t>(std::lround(unit * std::log(static_cast<double>(value))));
  return logarithms;
}

bool is_usable(int value) { return value >= darkest && value <= brightest; }

/// Of two middle values the mean.
double median(std::vector<std::int32_t>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

/// A dense symmetric positive definite system of equations, solved by Gauss' elimination.
class Equations {
 public:
  explicit Equations(std::size_t size) : size_(size), left_(size * size), right_(size) {}

  double& left(std::size_t row, std::size_t column) { return left_[row * size_ + column]; }
  double& right(std::size_t row) { return right_[row]; }

  std::vector<double> solve() && {
    for (std::size_t k = 0; k < size_; ++k)
      for (std::size_t row = k + 1; row < size_; ++row) {
        const double factor = left(row, k) / left(k, k);
        for (std::size_t column = k; column < size_; ++column)
          left(row, column) -= factor * left(k, column);
        right_[row] -= factor * right_[k];
      }
    for (std::size_t k = size_; k-- > 0;) {
      for (std::size_t column = k + 1; column < size_; ++column)
        right_[k] -= left(k, column) * right_[column];
      right_[k] /= left(k, k);
    }
    return std::move(right_);
  }

 private:
  std::size_t size_;
  std::vector<double> left_, right_;
};

/// For each camera the smallest number of one that it is linked with, over any number of pairs.
std::vector<std::size_t> components(std::size_t cameras,
                                    const std::vector<std::pair<std::size_t, std::size_t>>& pairs) {
  std::vector<std::size_t> component(cameras);
  for (std::size_t k = 0; k < cameras; ++k) component[k] = k;
  for (const auto& [first, second] : pairs) {
    const std::size_t kept = std::min(component[first], component[second]);
    const std::size_t replaced = std::max(component[first], component[second]);
    std::replace(component.begin(), component.end(), replaced, kept);
  }
  return component;
}

}  // namespace

Exposures::Exposures(std::size_t cameras)
    : cameras_(cameras), ratios_(cameras * (cameras - 1) / 2) {}

void Exposures::add(std::size_t first, const std::array<std::uint8_t, 3>& first_color,
                    std::size_t second, const std::array<std::uint8_t, 3>& second_color) {
  static const auto logarithms = make_logarithms();
  Ratios& ratios = between(first, second);
  for (std::size_t channel = 0; channel < 3; ++channel) {
    const std::uint8_t a = first_color[channel], b = second_color[channel];
    if (is_usable(a) && is_usable(b)) ratios[channel].push_back(logarithms[a] - logarithms[b]);
  }
}

std::vector<Gains> Exposures::gains() {
  std::vector<Gains> gains(cameras_);
  for (std::size_t channel = 0; channel < 3; ++channel) {
    const std::vector<double> logarithms = solve(channel);
    for (std::size_t k = 0; k < cameras_; ++k)
      gains[k][channel] = std::clamp(std::round(unit * std::exp(logarithms[k] / unit)) / unit,
                                     1 / largest_gain, largest_gain);
  }
  return gains;
}

/// Logarithms of the gains of one channel, in units: minimises the sum over pairs of
/// n (second - first - median)^2. One more equation a component, that its sum is 0, is added as a
/// square, which the minimum makes 0.
std::vector<double> Exposures::solve(std::size_t channel) {
  Equations equations(cameras_);
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t second = 1; second < cameras_; ++second)
    for (std::size_t first = 0; first < second; ++first) {
      std::vector<std::int32_t>& ratios = between(first, second)[channel];
      if (ratios.size() < fewest) continue;
      const auto weight = static_cast<double>(ratios.size());
      const double pull = weight * median(ratios);
      equations.left(first, first) += weight;
      equations.left(second, second) += weight;
      equations.left(first, second) -= weight;
      equations.left(second, first) -= weight;
      equations.right(first) -= pull;
      equations.right(second) += pull;
      pairs.emplace_back(first, second);
    }
  const std::vector<std::size_t> component = components(cameras_, pairs);
  for (std::size_t row = 0; row < cameras_; ++row)
    for (std::size_t column = 0; column < cameras_; ++column)
      if (component[row] == component[column]) equations.left(row, column) += 1;
  return std::move(equations).solve();
}

}  // namespace fusionslam::detail
