// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "../detail/parallel.hpp"
#include "alignment.hpp"
#include "thumbnail.hpp"

namespace fusionslam {
namespace detail {

struct AlignedScenes {
  AlignmentConfig config;
  std::vector<RangeImage> images;
  std::vector<Thumbnail> thumbnails;
};

namespace {

using Candidate = std::pair<float, std::size_t>;  // distance of the thumbnails, number

/// Candidates with the most similar thumbnails, those `near` first; all with comparable thumbnails.
std::vector<Candidate> candidates_of(const AlignedScenes& scenes, const Thumbnail& thumbnail,
                                     const std::vector<std::size_t>& near, std::size_t most) {
  std::vector<Candidate> found;
  for (std::size_t i = 0; i < scenes.thumbnails.size(); ++i) {
    if (i % 4096 == 0) check_interrupt();
    const float distance = thumbnail_distance(thumbnail, scenes.thumbnails[i]);
    if (std::isfinite(distance)) found.emplace_back(distance, i);
  }
  const auto first = std::partition(found.begin(), found.end(), [&](const Candidate& one) {
    return std::find(near.begin(), near.end(), one.second) != near.end();
  });
  if (found.size() > most) {
    const auto last = found.begin() + static_cast<std::ptrdiff_t>(most);
    std::nth_element(std::min(first, last), last, found.end());
    found.resize(most);
  }
  std::sort(found.begin(), found.end());
  return found;
}

std::vector<AlignedScene> align_all(const AlignedScenes& scenes, const Scene& current,
                                    const std::vector<Candidate>& candidates, int threads) {
  const PreparedView view = prepare(current.image);
  std::vector<AlignedScene> found(candidates.size());
  parallel_for(found.size(), threads, [&](std::size_t i) {
    const auto [distance, number] = candidates[i];
    found[i] = {number, align_views(view, prepare(scenes.images[number]), distance, scenes.config)};
  });
  std::sort(found.begin(), found.end(), [](const AlignedScene& a, const AlignedScene& b) {
    if (a.alignment.probability != b.alignment.probability)
      return a.alignment.probability > b.alignment.probability;
    return a.number < b.number;
  });
  return found;
}

}  // namespace
}  // namespace detail

struct AlignmentIndex::Storage : detail::AlignedScenes {};

AlignmentIndex::AlignmentIndex(const AlignmentConfig& config)
    : scenes_(std::make_unique<Storage>()) {
  validate(config);
  scenes_->config = config;
}

AlignmentIndex::~AlignmentIndex() = default;
AlignmentIndex::AlignmentIndex(AlignmentIndex&&) noexcept = default;
AlignmentIndex& AlignmentIndex::operator=(AlignmentIndex&&) noexcept = default;

std::size_t AlignmentIndex::size() const { return scenes_->images.size(); }

const AlignmentConfig& AlignmentIndex::config() const { return scenes_->config; }

std::size_t AlignmentIndex::add(const Scene& scene) {
  scenes_->images.push_back(scene.image);
  try {
    scenes_->thumbnails.push_back(detail::thumbnail_of(scene.image));
  } catch (...) {
    scenes_->images.pop_back();
    throw;
  }
  return size() - 1;
}

const RangeImage& AlignmentIndex::image(std::size_t number) const {
  if (number >= size())
    throw ConfigError("there is no scene " + std::to_string(number) + " among " +
                      std::to_string(size()));
  return scenes_->images[number];
}

void AlignmentIndex::remove(std::size_t number) {
  image(number);
  const auto place = static_cast<std::ptrdiff_t>(number);
  scenes_->thumbnails.erase(scenes_->thumbnails.begin() + place);
  scenes_->images.erase(scenes_->images.begin() + place);
}

std::vector<AlignedScene> AlignmentIndex::query(const Scene& current, int threads) const {
  return query_near(current, {}, static_cast<std::size_t>(config().candidates), threads);
}

std::vector<AlignedScene> AlignmentIndex::query_near(const Scene& current,
                                                     const std::vector<std::size_t>& near,
                                                     std::size_t most, int threads) const {
  for (const std::size_t number : near) image(number);
  const auto candidates =
      detail::candidates_of(*scenes_, detail::thumbnail_of(current.image), near, most);
  return detail::align_all(*scenes_, current, candidates, threads);
}

}  // namespace fusionslam
