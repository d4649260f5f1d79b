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
#include <span>
#include <string>
#include <system_error>

#include "../detail/interrupt.hpp"
#include "fusionslam/errors.hpp"
#include "row_chunks.hpp"

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
class Checksum {
 public:
  void add(const void* data, std::size_t size) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (std::size_t i = 0; i < size; ++i) value_ = (value_ ^ bytes[i]) * 0x100000001b3ULL;
  }
  std::uint64_t value() const { return value_; }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325ULL;
};

[[noreturn]] void refuse(const std::string& path, const std::string& why) {
  throw DataError(path + ": " + why);
}

/// Writes a new file beside `path` and moves it there at the end; leaves nothing behind if it is
/// interrupted before. Computes the checksum of all that it writes.
class Writer {
 public:
  explicit Writer(const std::string& path)
      : path_(path), temporary_(temporary_name(path)), file_(temporary_, std::ios::binary) {
    if (!file_) refuse(path, std::string("cannot be written: ") + std::strerror(errno));
  }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
  ~Writer() {
    std::error_code ignored;
    if (!moved_) std::filesystem::remove(temporary_, ignored);
  }

  template <class T>
  void write(std::span<const T> values) {
    detail::check_interrupt();
    sum_.add(values.data(), values.size_bytes());
    file_.write(reinterpret_cast<const char*>(values.data()),
                static_cast<std::streamsize>(values.size_bytes()));
    if (!file_) fail(std::strerror(errno));
  }

  void finish() {
    const std::uint64_t sum = sum_.value();
    write(std::span<const std::uint64_t>(&sum, 1));
    file_.close();
    if (!file_) fail(std::strerror(errno));
    std::error_code error;
    std::filesystem::rename(temporary_, path_, error);
    if (error) fail(error.message());
    moved_ = true;
  }

 private:
  static std::string temporary_name(const std::string& path) {
    static std::atomic<unsigned> number{0};  // threads may save to one path at a time
    return path + "." + std::to_string(::getpid()) + "." + std::to_string(number++) + ".tmp";
  }
  [[noreturn]] void fail(const std::string& why) const {
    refuse(path_, "cannot be written: " + why);
  }

  std::string path_;
  std::string temporary_;
  std::ofstream file_;
  Checksum sum_;
  bool moved_ = false;
};

/// Reads a file from its beginning and computes the checksum of all that it reads.
class Reader {
 public:
  explicit Reader(const std::string& path) : path_(path), file_(path, std::ios::binary) {
    if (!file_) refuse(path, std::string("cannot be read: ") + std::strerror(errno));
  }

  template <class T>
  void read(std::span<T> values) {
    detail::check_interrupt();
    file_.read(reinterpret_cast<char*>(values.data()),
               static_cast<std::streamsize>(values.size_bytes()));
    if (!file_) refuse(path_, "cannot be read to its end");
    sum_.add(values.data(), values.size_bytes());
  }

  void check_sum() {
    const std::uint64_t expected = sum_.value();
    std::uint64_t sum = 0;
    read(std::span(&sum, 1));
    if (sum != expected) refuse(path_, "damaged: its checksum does not fit its content");
  }

 private:
  std::string path_;
  std::ifstream file_;
  Checksum sum_;
};

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
  const bool too_short = header.dimension > size || body / row < header.count;
  if (!too_short && body % row == 0 && body / row == header.count) return;
  const std::string descriptors = std::to_string(header.count) + " descriptors of length " +
                                  std::to_string(header.dimension) + " that its header names";
  if (too_short)
    refuse(path, std::to_string(size) + " bytes do not hold the " + descriptors + " (cut off?)");
  refuse(path, std::to_string(body - header.count * row) + " bytes longer than the " + descriptors);
}

}  // namespace

void DescriptorIndex::save(const std::string& path) const {
  Header header{};
  std::memcpy(header.magic, magic, sizeof(magic));
  header.version = version;
  header.byte_order = byte_order_mark;
  header.dimension = dimension();
  header.window_frames = window_.frames;
  header.window_nanoseconds = window_.nanoseconds;
  header.count = size();
  Writer writer(path);
  writer.write(std::span<const Header>(&header, 1));
  writer.write(std::span<const std::int64_t>(stamps_ns_));
  for (std::size_t i = 0; i < rows_->chunk_count(); ++i) writer.write(rows_->chunk(i));
  writer.finish();
}

DescriptorIndex DescriptorIndex::load(const std::string& path) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (error) refuse(path, "cannot be read: " + error.message());
  if (size < sizeof(Header) + sizeof(std::uint64_t))
    refuse(path, std::to_string(size) + " bytes are too few for a descriptor index (cut off?)");
  Reader reader(path);
  Header header{};
  reader.read(std::span(&header, 1));
  check_header(path, header);
  check_size(path, header, size);

  DescriptorIndex index(header.dimension, {header.window_frames, header.window_nanoseconds});
  index.stamps_ns_.resize(header.count);
  reader.read(std::span(index.stamps_ns_));
  for (std::size_t left = header.count; left > 0;) {
    const std::span<float> rows = index.rows_->append_rows(left);
    reader.read(rows);
    left -= rows.size() / header.dimension;
  }
  reader.check_sum();
  return index;
}

}  // namespace fusionslam
