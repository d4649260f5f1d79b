// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The file: magic, version, byte order mark, dimension, window, count, stamps, descriptors,
// checksum.
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>

#include "fusionslam/errors.hpp"
#include "fusionslam/matching.hpp"

namespace fusionslam {
namespace {

constexpr char magic[8] = {'F', 'S', 'L', 'M', 'I', 'N', 'D', 'X'};
constexpr std::uint32_t version = 1;
constexpr std::uint32_t byte_order_mark = 0x01020304;

struct Header {
  char magic[8];
  std::uint32_t version;
  std::uint32_t byte_order;
  std::uint64_t dimension;
  std::uint64_t window_frames;
  std::int64_t window_nanoseconds;
  std::uint64_t count;
};

/// FNV-1a: enough to notice damage, not meant against forgery.
std::uint64_t checksum(std::uint64_t hash, const void* data, std::size_t size) {
  const auto* bytes = static_cast<const unsigned char*>(data);
  for (std::size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * 0x100000001b3ULL;
  return hash;
}

constexpr std::uint64_t checksum_start = 0xcbf29ce484222325ULL;

std::uint64_t checksum(const Header& header, const std::vector<std::int64_t>& stamps,
                       const std::vector<float>& descriptors) {
  std::uint64_t hash = checksum(checksum_start, &header, sizeof(header));
  hash = checksum(hash, stamps.data(), stamps.size() * sizeof(stamps[0]));
  return checksum(hash, descriptors.data(), descriptors.size() * sizeof(descriptors[0]));
}

[[noreturn]] void refuse(const std::string& path, const std::string& why) {
  throw DataError(path + ": " + why);
}

template <class T>
void write(std::ofstream& file, const T* data, std::size_t count) {
  file.write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(count * sizeof(T)));
}

template <class T>
void read(std::ifstream& file, T* data, std::size_t count) {
  file.read(reinterpret_cast<char*>(data), static_cast<std::streamsize>(count * sizeof(T)));
}

void check_header(const std::string& path, const Header& header) {
  if (std::memcmp(header.magic, magic, sizeof(magic)) != 0)
    refuse(path, "not a fusionslam descriptor index");
  if (header.byte_order != byte_order_mark)
    refuse(path, "written on a machine of other byte order");
  if (header.version != version)
    refuse(path, "version " + std::to_string(header.version) + ", this program reads version " +
                     std::to_string(version));
  if (header.dimension == 0 || header.window_nanoseconds < 0) refuse(path, "damaged header");
}

void check_size(const std::string& path, const Header& header, std::uintmax_t size) {
  const std::uintmax_t body = size - sizeof(Header) - sizeof(std::uint64_t);
  const std::uintmax_t row = sizeof(std::int64_t) + header.dimension * sizeof(float);
  if (header.dimension > size || body % row != 0 || body / row != header.count)
    refuse(path, std::to_string(size) + " bytes do not hold the " + std::to_string(header.count) +
                     " descriptors of length " + std::to_string(header.dimension) +
                     " that its header names (cut off?)");
}

}  // namespace

void DescriptorIndex::save(const std::string& path) const {
  Header header{};
  std::memcpy(header.magic, magic, sizeof(magic));
  header.version = version;
  header.byte_order = byte_order_mark;
  header.dimension = dimension_;
  header.window_frames = window_.frames;
  header.window_nanoseconds = window_.nanoseconds;
  header.count = size();
  const std::uint64_t sum = checksum(header, stamps_ns_, descriptors_);

  static std::atomic<unsigned> number{0};  // threads may save to one path at a time
  const std::string temporary =
      path + "." + std::to_string(::getpid()) + "." + std::to_string(number++) + ".tmp";
  std::ofstream file(temporary, std::ios::binary);
  if (!file) refuse(path, std::string("cannot be written: ") + std::strerror(errno));
  write(file, &header, 1);
  write(file, stamps_ns_.data(), stamps_ns_.size());
  write(file, descriptors_.data(), descriptors_.size());
  write(file, &sum, 1);
  file.close();
  std::error_code error;
  if (file) std::filesystem::rename(temporary, path, error);
  if (!file || error) {
    const std::string why = error ? error.message() : std::strerror(errno);
    std::filesystem::remove(temporary, error);
    refuse(path, "cannot be written: " + why);
  }
}

DescriptorIndex DescriptorIndex::load(const std::string& path) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (error) refuse(path, "cannot be read: " + error.message());
  std::ifstream file(path, std::ios::binary);
  if (!file) refuse(path, std::string("cannot be read: ") + std::strerror(errno));
  if (size < sizeof(Header) + sizeof(std::uint64_t))
    refuse(path, std::to_string(size) + " bytes are too few for a descriptor index (cut off?)");
  Header header{};
  read(file, &header, 1);
  check_header(path, header);
  check_size(path, header, size);

  DescriptorIndex index(header.dimension, {header.window_frames, header.window_nanoseconds});
  index.stamps_ns_.resize(header.count);
  index.descriptors_.resize(header.count * header.dimension);
  std::uint64_t sum = 0;
  read(file, index.stamps_ns_.data(), index.stamps_ns_.size());
  read(file, index.descriptors_.data(), index.descriptors_.size());
  read(file, &sum, 1);
  if (!file) refuse(path, "cannot be read to its end");
  if (sum != checksum(header, index.stamps_ns_, index.descriptors_))
    refuse(path, "damaged: its checksum does not fit its content");
  return index;
}

}  // namespace fusionslam
