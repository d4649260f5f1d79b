// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Files of descriptor indexes: refused, or an index that answers.
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <fstream>
#include <string>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/matching.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::string path = "/dev/shm/fusionslam-fuzz-index-" + std::to_string(::getpid());
  if (size == 0) {  // the first input of a run: a valid file to start from
    fusionslam::DescriptorIndex index(3);
    for (int i = 0; i < 4; ++i) index.add(std::vector<float>{float(i), 1, 2}, i);
    index.save(path);
    return 0;
  }
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(data), std::streamsize(size));
  try {
    const auto index = fusionslam::DescriptorIndex::load(path);
    index.query(std::vector<float>(index.dimension(), 0.5f), 3, 1000);
  } catch (const fusionslam::DataError&) {
  } catch (const fusionslam::ShapeError&) {
  } catch (const fusionslam::ConfigError&) {
  }
  return 0;
}
