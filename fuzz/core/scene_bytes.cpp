// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Bytes of scenes: refused, or a scene whose bytes give the same scene.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/views/scene.hpp"
#include "fusionslam/views/similarity.hpp"
#include "spoil.hpp"

namespace {

using Bytes = std::vector<std::uint8_t>;

/// Three objects, and a range image of twelve cells with a gap.
Bytes small_scene() {
  fusionslam::Scene scene;
  for (int i = 1; i <= 3; ++i) {
    const double m = i;
    scene.objects.push_back(
        {{m, -m, 0.5}, m, 6 * m, {80 * m, 9, 0}, {m, m, 1}, {0, 0, 0}, {m, m, 1}, 20 * i});
  }
  scene.image = {1, 2, {0, 0, 0.17F}, {}};
  for (std::int16_t i = 0; i < 12; ++i)
    scene.image.cells.push_back({static_cast<std::int16_t>(i % 6 + i % 2),
                                 static_cast<std::int16_t>(i / 6),
                                 static_cast<std::uint16_t>(100 + 9 * i),
                                 {8, 16, static_cast<std::uint8_t>(8 * i)}});
  return fusionslam::scene_to_bytes(scene);
}

/// Ends with the right checksum (CRC-16/CCITT), without which nothing else is looked at.
void seal(Bytes& bytes) {
  unsigned sum = 0xffff;
  for (const std::uint8_t byte : bytes) {
    sum ^= static_cast<unsigned>(byte) << 8;
    for (int bit = 0; bit < 8; ++bit) sum = (sum & 0x8000) ? (sum << 1) ^ 0x1021 : sum << 1;
  }
  bytes.push_back(static_cast<std::uint8_t>(sum & 0xff));
  bytes.push_back(static_cast<std::uint8_t>(sum >> 8 & 0xff));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzedDataProvider source(data, size);
  static const Bytes valid = small_scene();
  const bool sealed = source.ConsumeIntegralInRange(0, 7) != 1;
  Bytes bytes = valid;
  if (sealed) bytes.resize(bytes.size() - 2);
  spoil(bytes, source);
  if (sealed) seal(bytes);
  try {
    const auto scene = fusionslam::scene_from_bytes(bytes);
    const auto again = fusionslam::scene_to_bytes(scene);
    if (fusionslam::scene_to_bytes(fusionslam::scene_from_bytes(again)) != again) std::abort();
    if (std::isnan(fusionslam::scene_similarity(scene, scene))) std::abort();
  } catch (const fusionslam::DataError&) {
  } catch (const fusionslam::ShapeError&) {
  } catch (const fusionslam::ConfigError&) {
  }
  return 0;
}
