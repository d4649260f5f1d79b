// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The file: magic, version, byte order mark, dimension, window, count, in version 2 the metric
// (version 1: L2), stamps, descriptors, checksum.
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "../detail/atomic_file.hpp"
#include "../detail/checks.hpp"
#include "../detail/interrupt.hpp"
#include "fusionslam/errors.hpp"
#include "metrics/row_metric.hpp"
#include "row_chunks.hpp"

namespace fusionslam {
namespace {

constexpr char magic[8] = {'F', 'S', 'L', 'M', 'I', 'N', 'D', 'X'};
constexpr std::uint32_t version_of_l2 = 1;  // earlier programs read it
constexpr std::uint32_t version_with_metric = 2;
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

/// Writes parts of an index and computes the checksum of them all.
template <class Sink>
class Writer {
 public:
  explicit Writer(Sink& sink) : sink_(sink) {}

  template <class T>
  void write(std::span<const T> values) {
    detail::check_interrupt();
    sum_.add(values.data(), values.size_bytes());
    sink_.write(std::as_bytes(values));
  }
  void write_sum() {
    const std::uint64_t sum = sum_.value();
    write(std::span(&sum, 1));
  }

 private:
  Sink& sink_;
  Checksum sum_;
};

/// Bytes in memory that grow.
struct MemorySink {
  std::vector<std::uint8_t> bytes;

  void write(std::span<const std::byte> more) {
    const auto* begin = reinterpret_cast<const std::uint8_t*>(more.data());
    bytes.insert(bytes.end(), begin, begin + more.size());
  }
};

/// Bytes in memory, read from the first on.
struct MemorySource {
  std::span<const std::uint8_t> bytes;
  std::string name = "bytes of a descriptor index";

  std::uintmax_t size() const { return bytes.size(); }
  void read(std::span<std::byte> to) {
    if (to.size() > bytes.size()) refuse(name, "cannot be read to its end");
    std::ranges::copy(std::as_bytes(bytes.first(to.size())), to.begin());
    bytes = bytes.subspan(to.size());
  }
};

/// A file, read from its beginning. What is no regular file is refused: a pipe would wait for ever.
class FileSource {
 public:
  explicit FileSource(const std::string& path)
      : name(path), file_(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC)) {
    struct stat status{};
    if (file_ < 0 || ::fstat(file_, &status) != 0)
      refuse(path, std::string("cannot be read: ") + std::strerror(errno));
    if (!S_ISREG(status.st_mode)) {
      ::close(file_);
      refuse(path, S_ISDIR(status.st_mode) ? "cannot be read: it is a folder, expected a file"
                                           : "cannot be read: it is a device, expected a file");
    }
    size_ = static_cast<std::uintmax_t>(status.st_size);
  }
  FileSource(const FileSource&) = delete;
  FileSource& operator=(const FileSource&) = delete;
  ~FileSource() { ::close(file_); }

  std::uintmax_t size() const { return size_; }
  void read(std::span<std::byte> to) {
    while (!to.empty()) {
      const ssize_t count = ::read(file_, to.data(), to.size());
      if (count < 0 && errno == EINTR) continue;
      if (count <= 0) refuse(name, "cannot be read to its end");
      to = to.subspan(static_cast<std::size_t>(count));
    }
  }

  const std::string name;

 private:
  int file_;
  std::uintmax_t size_ = 0;
};

/// Reads parts of an index and computes the checksum of them all.
template <class Source>
class Reader {
 public:
  explicit Reader(Source& source) : source_(source) {}

  template <class T>
  void read(std::span<T> values) {
    detail::check_interrupt();
    source_.read(std::as_writable_bytes(values));
    sum_.add(values.data(), values.size_bytes());
  }
  void check_sum() {
    const std::uint64_t expected = sum_.value();
    std::uint64_t sum = 0;
    read(std::span(&sum, 1));
    if (sum != expected) refuse(source_.name, "damaged: its checksum does not fit its content");
  }

 private:
  Source& source_;
  Checksum sum_;
};

void check_header(const std::string& path, const Header& header) {
  if (std::memcmp(header.magic, magic, sizeof(magic)) != 0)
    refuse(path, "not a fusionslam descriptor index");
  if (header.byte_order != byte_order_mark)
    refuse(path, "written on a machine of other byte order");
  if (header.version != version_of_l2 && header.version != version_with_metric)
    refuse(path, "version " + std::to_string(header.version) + ", this program reads version " +
                     std::to_string(version_of_l2) + " and " + std::to_string(version_with_metric));
  if (header.dimension == 0 || header.window_nanoseconds < 0) refuse(path, "damaged header");
}

/// `body` is what remains for stamps and descriptors.
void check_size(const std::string& path, const Header& header, std::uintmax_t size,
                std::uintmax_t body) {
  const std::uintmax_t row = sizeof(std::int64_t) + header.dimension * sizeof(float);
  const bool too_short = header.dimension > size || body / row < header.count;
  if (!too_short && body % row == 0 && body / row == header.count) return;
  const std::string descriptors = detail::count_text(header.count, "descriptor") + " of length " +
                                  std::to_string(header.dimension) + " that its header names";
  if (too_short)
    refuse(path,
           detail::count_text(size, "byte") + " cannot hold the " + descriptors + " (cut off?)");
  refuse(path,
         detail::count_text(body - header.count * row, "byte") + " longer than the " + descriptors);
}

DescriptorIndex make_index(const std::string& path, const Header& header, std::uint64_t metric) {
  const std::size_t known = ChoiceNames<Metric>::value.size();
  if (metric >= known)
    refuse(path, "its header names metric " + std::to_string(metric) +
                     ", this program knows 0 to " + std::to_string(known - 1));
  try {
    return DescriptorIndex(header.dimension, {header.window_frames, header.window_nanoseconds},
                           static_cast<Metric>(metric));
  } catch (const ShapeError& error) {
    refuse(path, error.what());
  }
}

}  // namespace

template <class Sink>
void DescriptorIndex::write(Sink& sink) const {
  Header header{};
  std::memcpy(header.magic, magic, sizeof(magic));
  header.version = metric_ == Metric::l2 ? version_of_l2 : version_with_metric;
  header.byte_order = byte_order_mark;
  header.dimension = dimension();
  header.window_frames = window_.frames;
  header.window_nanoseconds = window_.nanoseconds;
  header.count = size();
  Writer writer(sink);
  writer.write(std::span<const Header>(&header, 1));
  const auto metric = static_cast<std::uint64_t>(metric_);
  if (metric_ != Metric::l2) writer.write(std::span<const std::uint64_t>(&metric, 1));
  writer.write(std::span<const std::int64_t>(stamps_ns_));
  for (std::size_t i = 0; i < rows_->chunk_count(); ++i) writer.write(rows_->chunk(i));
  writer.write_sum();
}

/// The checksum finds damage, but anyone can compute it.
void DescriptorIndex::check_content(const std::string& name) const {
  try {
    for (std::size_t i = 0; i < size(); ++i) detail::check_row(row_metric_.get(), descriptor(i), i);
  } catch (const DataError& error) {
    refuse(name, error.what());
  }
}

template <class Source>
DescriptorIndex DescriptorIndex::read(Source&& source) {
  const std::uintmax_t size = source.size();
  const auto too_short = [&] {
    refuse(source.name,
           "too short for a descriptor index, " + detail::count_text(size, "byte") + " (cut off?)");
  };
  std::uintmax_t rest = sizeof(Header) + sizeof(std::uint64_t);
  if (size < rest) too_short();
  Reader reader(source);
  Header header{};
  reader.read(std::span(&header, 1));
  check_header(source.name, header);
  std::uint64_t metric = 0;
  if (header.version == version_with_metric) {
    rest += sizeof(metric);
    if (size < rest) too_short();
    reader.read(std::span(&metric, 1));
  }
  check_size(source.name, header, size, size - rest);

  DescriptorIndex index = make_index(source.name, header, metric);
  index.stamps_ns_.resize(header.count);
  reader.read(std::span(index.stamps_ns_));
  for (std::size_t left = header.count; left > 0;) {
    const std::span<float> rows = index.rows_->append_rows(left);
    reader.read(rows);
    left -= rows.size() / header.dimension;
  }
  reader.check_sum();
  index.check_content(source.name);
  for (std::size_t i = 0; i < index.size(); ++i) index.append_cache(index.descriptor(i));
  return index;
}

void DescriptorIndex::save(const std::string& path) const {
  detail::AtomicFile file(path);
  write(file);
  file.replace();
}

DescriptorIndex DescriptorIndex::load(const std::string& path) { return read(FileSource(path)); }

std::vector<std::uint8_t> DescriptorIndex::to_bytes() const {
  MemorySink sink;
  write(sink);
  return std::move(sink.bytes);
}

DescriptorIndex DescriptorIndex::from_bytes(std::span<const std::uint8_t> bytes) {
  return read(MemorySource{bytes});
}

}  // namespace fusionslam
