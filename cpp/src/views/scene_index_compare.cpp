// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <vector>

#include "../detail/interrupt.hpp"
#include "color_difference.hpp"
#include "scene_index.hpp"
#include "similarity_kernel.hpp"

namespace fusionslam::detail {
namespace {

constexpr std::size_t block_objects = 256;  // whose columns stay in the first cache

KernelTerm to_float_term(const Term& term) {
  return {static_cast<float>(term.x0), static_cast<float>(term.a), static_cast<float>(term.factor)};
}

std::array<const double*, 3> from(const std::array<std::vector<double>, 3>& columns,
                                  std::size_t begin) {
  return {columns[0].data() + begin, columns[1].data() + begin, columns[2].data() + begin};
}

/// Compares the current scene with neighbouring stored ones, whose objects it walks through once
/// for each object of the current scene.
class Comparison {
 public:
  Comparison(const StoredScenes& stored, const std::vector<ComparedObject>& current,
             SimdLevel level)
      : stored_(stored), current_(current), kernels_(similarity_kernels(level)) {
    for (const auto& object : current) total_ += object.weight;
  }

  void block(std::size_t begin, std::size_t end, double* result) {
    first_ = stored_.begin_of(begin);
    size_ = stored_.ends[end - 1] - first_;
    best_.assign(size_, 0.0F);
    std::fill(result, result + (end - begin), 0.0);
    for (const auto& object : current_) {
      check_interrupt();
      compare(object);
      kernels_.keep_best(sums_.data(), size_, best_.data());
      add_bests(object.weight, begin, end, result);
    }
    for (std::size_t i = begin; i < end; ++i) result[i - begin] = finish(i, result[i - begin]);
  }

 private:
  /// The similarity of one object to all of the block, in sums_.
  void compare(const ComparedObject& object) {
    sums_.assign(size_, 0.0F);
    const Terms& terms = stored_.terms;
    KernelRow row{size_, nullptr, 0, sums_.data()};
    add_color(object, row);
    if (terms.volume.factor > 0)
      kernels_.add_absolute(object.volume, stored_.volume.data() + first_,
                            to_float_term(terms.volume), row);
    if (terms.ratio.factor > 0)
      kernels_.add_absolute(object.ratio, stored_.ratio.data() + first_, to_float_term(terms.ratio),
                            row);
    if (stored_.config.range_slack > 0) {
      row.closeness = stored_.closeness.data() + first_;
      row.own_closeness = static_cast<float>(object.closeness);
    }
    if (terms.distance.factor > 0)
      kernels_.add_distance(object.center.data(), from(stored_.center, first_),
                            to_float_term(terms.distance), row);
    if (terms.extent.factor > 0)
      kernels_.add_distance(object.extents.data(), from(stored_.extents, first_),
                            to_float_term(terms.extent), row);
  }

  void add_color(const ComparedObject& object, const KernelRow& row) {
    const Term& term = stored_.terms.color;
    if (!(term.factor > 0)) return;
    const auto columns = from(stored_.color, first_);
    if (stored_.config.color_difference != ColorDifference::ciede2000) {
      kernels_.add_distance(object.color.data(), columns, to_float_term(term), row);
      return;
    }
    differences_.resize(size_);
    for (std::size_t i = 0; i < size_; ++i)
      differences_[i] = static_cast<float>(coordinate_difference(
          object.color, {columns[0][i], columns[1][i], columns[2][i]}, ColorDifference::ciede2000));
    kernels_.add_given(differences_.data(), to_float_term(term), row);
  }

  void add_bests(double weight, std::size_t begin, std::size_t end, double* result) const {
    std::size_t i = 0;
    for (std::size_t scene = begin; scene < end; ++scene) {
      float best = 0;
      for (const std::size_t last = stored_.ends[scene] - first_; i < last; ++i)
        best = std::max(best, sums_[i]);
      result[scene - begin] += weight * static_cast<double>(best);
    }
  }

  double finish(std::size_t scene, double sum) const {
    const std::size_t begin = stored_.begin_of(scene), end = stored_.ends[scene];
    if (current_.empty() || begin == end) return current_.empty() && begin == end ? 1 : 0;
    const double forward = sum / total_;
    if (!stored_.config.symmetric) return std::min(1.0, forward);
    double other = 0, weight = 0;
    for (std::size_t i = begin; i < end; ++i) {
      other += static_cast<double>(stored_.weight[i] * best_[i - first_]);
      weight += static_cast<double>(stored_.weight[i]);
    }
    return std::min(1.0, (forward + other / weight) / 2);
  }

  const StoredScenes& stored_;
  const std::vector<ComparedObject>& current_;
  SimilarityKernels kernels_;
  double total_ = 0;
  std::size_t first_ = 0, size_ = 0;  ///< the block's objects
  std::vector<float> sums_, best_, differences_;
};

}  // namespace

void compare_scenes(const StoredScenes& stored, const std::vector<ComparedObject>& current,
                    std::size_t begin, std::size_t end, SimdLevel level, double* result) {
  Comparison comparison(stored, current, level);
  for (std::size_t first = begin; first < end;) {
    std::size_t last = first + 1;
    while (last < end && stored.ends[last] - stored.begin_of(first) <= block_objects) ++last;
    comparison.block(first, last, result + (first - begin));
    first = last;
  }
}

}  // namespace fusionslam::detail
