// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// For each KITTI scan (.bin) given, the nearest one before it: describe_and_match 0.bin 1.bin ...
#include <exception>
#include <filesystem>
#include <fstream>
#include <fusionslam/fusionslam.hpp>
#include <iostream>
#include <string>
#include <vector>

/// x, y, z and reflectance of each point, one after the other.
std::vector<float> load_scan(const std::string& path) {
  const auto bytes = std::filesystem::file_size(path);
  if (bytes % 16 != 0)
    throw fusionslam::DataError(path + ": " + std::to_string(bytes) + " bytes, no multiple of 16");
  std::vector<float> values(bytes / sizeof(float));
  std::ifstream file(path, std::ios::binary);
  if (!file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(bytes)))
    throw fusionslam::DataError(path + ": cannot be read");
  return values;
}

int main(int argc, char** argv) try {
  const std::vector<std::string> paths(argv + 1, argv + argc);
  fusionslam::DescriptorIndex index(192);
  for (const auto& path : paths) {
    const auto scan = load_scan(path);
    const auto descriptor = fusionslam::m2dp({scan.data(), scan.size() / 4, 4});
    for (const auto& match : index.query(descriptor))
      std::cout << path << " is nearest to " << paths.at(static_cast<std::size_t>(match.index))
                << ", distance " << match.distance << '\n';
    index.add(descriptor);
  }
} catch (const std::exception& error) {
  std::cerr << "describe_and_match: " << error.what() << '\n';
  return 1;
}
