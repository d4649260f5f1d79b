// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "scene_index.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <type_traits>
#include <utility>

#include "../detail/parallel.hpp"

namespace fusionslam {
namespace {

using detail::ComparedObject;
using detail::StoredScenes;

using Objects = std::vector<ComparedObject>;

/// Calls visit(column, value) for every column, with how its value is got from an object.
template <class Scenes, class Visitor>
void visit_columns(Scenes& scenes, Visitor&& visit) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    visit(scenes.color[axis], [=](const ComparedObject& o) { return o.color[axis]; });
    visit(scenes.center[axis], [=](const ComparedObject& o) { return o.center[axis]; });
    visit(scenes.extents[axis], [=](const ComparedObject& o) { return o.extents[axis]; });
  }
  visit(scenes.volume, [](const ComparedObject& o) { return o.volume; });
  visit(scenes.ratio, [](const ComparedObject& o) { return o.ratio; });
  visit(scenes.closeness, [](const ComparedObject& o) { return static_cast<float>(o.closeness); });
  visit(scenes.weight, [](const ComparedObject& o) { return static_cast<float>(o.weight); });
}

/// Puts objects in the place of those from `begin` to `end`.
void splice(StoredScenes& scenes, std::size_t begin, std::size_t end, const Objects& objects) {
  visit_columns(scenes, [&](auto& column, auto&& value_of) {
    const auto at = [&](std::size_t i) { return column.begin() + static_cast<std::ptrdiff_t>(i); };
    std::remove_reference_t<decltype(column)> values;
    for (const auto& object : objects) values.push_back(value_of(object));
    const std::size_t kept = std::min(end - begin, values.size());
    const auto rest = std::copy_n(values.begin(), kept, at(begin)) - column.begin();
    column.erase(column.begin() + rest, at(end));
    column.insert(column.begin() + rest, values.begin() + static_cast<std::ptrdiff_t>(kept),
                  values.end());
  });
}

void check_number(const StoredScenes& scenes, std::size_t number) {
  if (number >= scenes.size())
    throw ConfigError("scene " + std::to_string(number) + " is not stored, there are " +
                      std::to_string(scenes.size()));
}

}  // namespace

namespace detail {

void StoredScenes::put(std::size_t scene, const std::vector<ComparedObject>& objects) {
  if (scene == size()) ends.push_back(volume.size());
  const std::size_t begin = begin_of(scene), end = ends[scene];
  splice(*this, begin, end, objects);
  for (std::size_t i = scene; i < size(); ++i) ends[i] = ends[i] + objects.size() - (end - begin);
}

void StoredScenes::remove(std::size_t scene) {
  put(scene, {});
  ends.erase(ends.begin() + static_cast<std::ptrdiff_t>(scene));
}

}  // namespace detail

struct SceneIndex::Storage : StoredScenes {
  using StoredScenes::StoredScenes;
};

SceneIndex::SceneIndex(const SimilarityConfig& config)
    : scenes_(std::make_unique<Storage>(config)) {}

SceneIndex::~SceneIndex() = default;
SceneIndex::SceneIndex(SceneIndex&&) noexcept = default;
SceneIndex& SceneIndex::operator=(SceneIndex&&) noexcept = default;

std::size_t SceneIndex::size() const { return scenes_->size(); }

const SimilarityConfig& SceneIndex::config() const { return scenes_->config; }

std::size_t SceneIndex::add(const Scene& scene) {
  scenes_->put(size(), detail::compared_objects(scene, scenes_->config));
  return size() - 1;
}

void SceneIndex::replace(std::size_t number, const Scene& scene) {
  check_number(*scenes_, number);
  scenes_->put(number, detail::compared_objects(scene, scenes_->config));
}

void SceneIndex::remove(std::size_t number) {
  check_number(*scenes_, number);
  scenes_->remove(number);
}

SceneIndexState SceneIndex::state() const {
  SceneIndexState state;
  state.ends.assign(scenes_->ends.begin(), scenes_->ends.end());
  visit_columns(std::as_const(*scenes_), [&](const auto& column, auto&&) {
    state.values.insert(state.values.end(), column.begin(), column.end());
  });
  return state;
}

void SceneIndex::restore(const SceneIndexState& state) {
  const std::size_t objects = state.ends.empty() ? 0 : state.ends.back();
  if (!std::is_sorted(state.ends.begin(), state.ends.end()) || objects > state.values.size() ||
      state.values.size() != SceneIndexState::columns * objects ||
      !std::all_of(state.values.begin(), state.values.end(),
                   [](double value) { return std::isfinite(value); }))
    throw DataError("state of a scene index: " + std::to_string(state.values.size()) +
                    " values, expected finite ones, " + std::to_string(SceneIndexState::columns) +
                    " for each of " + std::to_string(objects) + " objects in order");
  // The last two columns are closeness and weight, the number of points.
  const auto weights = state.values.end() - static_cast<std::ptrdiff_t>(objects);
  const auto between = [](double least, double most) {
    return [=](double value) { return value >= least && value <= most; };
  };
  if (!std::all_of(weights - static_cast<std::ptrdiff_t>(objects), weights, between(0, 1)) ||
      !std::all_of(weights, state.values.end(), between(1, 1e18)))
    throw DataError(
        "state of a scene index: an object's closeness is not 0 to 1, or its weight "
        "not 1 to 1e18");
  auto scenes = std::make_unique<Storage>(scenes_->config);
  scenes->ends.assign(state.ends.begin(), state.ends.end());
  auto next = state.values.begin();
  visit_columns(*scenes, [&](auto& column, auto&&) {
    column.assign(next, next + static_cast<std::ptrdiff_t>(objects));
    next += static_cast<std::ptrdiff_t>(objects);
  });
  scenes_ = std::move(scenes);
}

std::vector<double> SceneIndex::similarities(const Scene& current, int threads) const {
  constexpr std::size_t scenes_an_item = 512;
  const Objects objects = detail::compared_objects(current, scenes_->config);
  std::vector<double> result(size());
  const std::size_t items = (size() + scenes_an_item - 1) / scenes_an_item;
  const SimdLevel level = simd_level();
  detail::parallel_for(items, threads, [&](std::size_t item) {
    const std::size_t begin = item * scenes_an_item;
    const std::size_t end = std::min(begin + scenes_an_item, size());
    detail::compare_scenes(*scenes_, objects, begin, end, level, result.data() + begin);
  });
  return result;
}

}  // namespace fusionslam
