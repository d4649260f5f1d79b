// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Bytes of scenes: refused, or a scene whose bytes give the same scene.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "fusionslam/errors.hpp"
#include "fusionslam/views/scene.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const auto scene = fusionslam::scene_from_bytes(std::span(data, size));
    const auto bytes = fusionslam::scene_to_bytes(scene);
    if (fusionslam::scene_to_bytes(fusionslam::scene_from_bytes(bytes)) != bytes) std::abort();
  } catch (const fusionslam::DataError&) {
  } catch (const fusionslam::ShapeError&) {
  } catch (const fusionslam::ConfigError&) {
  }
  return 0;
}
