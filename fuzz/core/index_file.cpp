// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Files of descriptor indexes: refused, or an index that is stored as it was read, and answers.
#include <unistd.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/matching.hpp"
#include "spoil.hpp"

namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes small_index() {
  fusionslam::DescriptorIndex index(3);
  for (int i = 0; i < 4; ++i) index.add(std::vector<float>{float(i), 1, 2}, i);
  return index.to_bytes();
}

/// Ends with the right checksum (FNV-1a), without which nothing else is looked at.
void seal(Bytes& bytes) {
  std::uint64_t sum = 0xcbf29ce484222325ULL;
  for (const std::uint8_t byte : bytes) sum = (sum ^ byte) * 0x100000001b3ULL;
  const auto* begin = reinterpret_cast<const std::uint8_t*>(&sum);
  bytes.insert(bytes.end(), begin, begin + sizeof(sum));
}

fusionslam::DescriptorIndex load(const Bytes& bytes) {
  static const std::string path = "/dev/shm/fusionslam-fuzz-index-" + std::to_string(::getpid());
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
  return fusionslam::DescriptorIndex::load(path);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzedDataProvider source(data, size);
  static const Bytes valid = small_index();
  const bool through_file = source.ConsumeIntegralInRange(0, 15) == 1;
  const bool sealed = source.ConsumeIntegralInRange(0, 7) != 1;
  Bytes bytes = valid;
  if (sealed) bytes.resize(bytes.size() - sizeof(std::uint64_t));
  spoil(bytes, source);
  if (sealed) seal(bytes);
  try {
    const auto index = through_file ? load(bytes) : fusionslam::DescriptorIndex::from_bytes(bytes);
    if (index.to_bytes() != bytes) std::abort();
    for (const auto& match : index.query(std::vector<float>(index.dimension(), 0.5F), 3, 1000))
      if (std::isnan(match.distance)) std::abort();
  } catch (const fusionslam::DataError&) {
  } catch (const fusionslam::ShapeError&) {
  } catch (const fusionslam::ConfigError&) {
  }
  return 0;
}
