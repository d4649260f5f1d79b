// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>

namespace fusionslam::detail {

/// A new file that replaces the one at a path only when it is whole and on the disk. It gets the
/// mode of the old one, or what the umask leaves; a symbolic link is written through.
///
/// Until then it is `.NAME.xxxxxxxx` beside it, held by flock: what nobody holds was left by a
/// program that was killed, and the next writer of the same path removes it. Python's atomic_path
/// follows the same rules.
class AtomicFile {
 public:
  /// Throws WriteError, as the others do.
  explicit AtomicFile(const std::string& path);
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;
  /// Removes the new file unless it has replaced the old one.
  ~AtomicFile();

  void write(std::span<const std::byte> bytes);
  void replace();

 private:
  void create(unsigned mode);
  [[noreturn]] void fail(const std::string& why) const;
  [[noreturn]] void fail(int error) const;

  std::filesystem::path target_;  ///< without links
  std::filesystem::path temporary_;
  int file_ = -1;
};

}  // namespace fusionslam::detail
