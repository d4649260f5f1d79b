// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// Writes three small KITTI scans into a folder: two places, then the first again, moved by 3 m.
#include <fstream>
#include <iostream>
#include <random>
#include <string>
#include <vector>

namespace {

/// x y z reflectance, spread differently along each axis for each place.
std::vector<float> scan(unsigned place, float shift) {
  std::mt19937 random(place);
  std::uniform_real_distribution<float> uniform(0, 1);
  std::vector<float> values;
  for (int i = 0; i < 2000; ++i) {
    const float x = uniform(random), y = uniform(random), z = uniform(random);
    const float far = place == 1 ? x * x : std::min(x, 0.3F);
    values.insert(values.end(), {40 * far + shift, 15 * y * z, 4 * z * z, 0.5F});
  }
  return values;
}

bool write(const std::string& path, const std::vector<float>& values) {
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(values.data()),
             static_cast<std::streamsize>(values.size() * sizeof(float)));
  file.close();
  return file.good();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const std::string folder = argv[1];
  const bool fine = write(folder + "/0.bin", scan(1, 0)) && write(folder + "/1.bin", scan(2, 0)) &&
                    write(folder + "/2.bin", scan(1, 3));
  if (!fine) std::cerr << folder << " cannot be written\n";
  return fine ? 0 : 1;
}
