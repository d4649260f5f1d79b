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

std::vector<Candidate> candidates_of(const AlignedScenes& scenes, const Thumbnail& thumbnail) {
  std::vector<Candidate> found;
  for (std::size_t i = 0; i < scenes.thumbnails.size(); ++i) {
    if (i % 4096 == 0) check_interrupt();
    const float distance = thumbnail_distance(thumbnail, scenes.thumbnails[i]);
    if (std::isfinite(distance)) found.emplace_back(distance, i);
  }
  const auto most = static_cast<std::size_t>(scenes.config.candidates);
  if (found.size() > most) {
    std::nth_element(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(most), found.end());
    found.resize(most);
  }
  std::sort(found.begin(), found.end());
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
  const auto candidates = detail::candidates_of(*scenes_, detail::thumbnail_of(current.image));
  const detail::PreparedView view = detail::prepare(current.image);
  std::vector<AlignedScene> found(candidates.size());
  detail::parallel_for(found.size(), threads, [&](std::size_t i) {
    const auto [distance, number] = candidates[i];
    found[i] = {number, detail::align_views(view, detail::prepare(scenes_->images[number]),
                                            distance, scenes_->config)};
  });
  std::sort(found.begin(), found.end(), [](const AlignedScene& a, const AlignedScene& b) {
    if (a.alignment.probability != b.alignment.probability)
      return a.alignment.probability > b.alignment.probability;
    return a.number < b.number;
  });
  return found;
}

}  // namespace fusionslam
