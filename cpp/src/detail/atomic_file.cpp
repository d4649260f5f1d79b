// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "atomic_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <random>
#include <string_view>
#include <system_error>

#include "fusionslam/errors.hpp"

namespace fusionslam::detail {
namespace {

namespace fs = std::filesystem;

// As Python's tempfile names files.
constexpr std::string_view letters = "abcdefghijklmnopqrstuvwxyz0123456789_";
constexpr std::size_t random_letters = 8;
constexpr std::time_t longest_write = 24 * 60 * 60;  // seconds; where flock is not supported
constexpr int most_links = 40;                       // as Linux has it
constexpr int most_tries = 100;

/// Where links lead to, which need not exist.
fs::path without_links(fs::path path) {
  std::error_code ignored;
  for (int links = 0; links < most_links && fs::is_symlink(path, ignored); ++links)
    path = path.parent_path() / fs::read_symlink(path, ignored);
  return path;
}

fs::path folder_of(const fs::path& target) {
  return target.has_parent_path() ? target.parent_path() : fs::path(".");
}

std::string temporary_prefix(const fs::path& target) {
  std::string prefix = ".";
  return prefix.append(target.filename().native()).append(".");
}

/// Cannot be foreseen, so that nobody can plant a link there.
std::string random_name() {
  std::random_device random;
  std::uniform_int_distribution<std::size_t> letter(0, letters.size() - 1);
  std::string name;
  while (name.size() < random_letters) name += letters[letter(random)];
  return name;
}

bool is_temporary(std::string_view name, std::string_view prefix) {
  return name.starts_with(prefix) && name.size() == prefix.size() + random_letters &&
         name.find_first_not_of(letters, prefix.size()) == std::string_view::npos;
}

/// Removes a temporary file unless its writer still holds it.
void remove_if_left(const fs::path& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (file < 0) return;
  struct stat status{};
  if (::fstat(file, &status) == 0 && S_ISREG(status.st_mode) &&
      (::flock(file, LOCK_EX | LOCK_NB) == 0 ||
       std::time(nullptr) - status.st_mtime > longest_write))
    ::unlink(path.c_str());
  ::close(file);
}

void remove_leftovers(const fs::path& target) {
  const std::string prefix = temporary_prefix(target);
  std::error_code error;
  for (fs::directory_iterator entry(folder_of(target), error), end; !error && entry != end;
       entry.increment(error))
    if (is_temporary(entry->path().filename().native(), prefix)) remove_if_left(entry->path());
}

/// Keeps the new name of a file through a loss of power, where the file system can.
void sync_folder(const fs::path& folder) {
  const int file = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (file < 0) return;
  ::fsync(file);
  ::close(file);
}

}  // namespace

AtomicFile::AtomicFile(const std::string& path) : target_(without_links(path)) {
  std::error_code ignored;
  if (fs::is_symlink(target_, ignored)) fail(ELOOP);
  struct stat old{};
  const bool replaces = ::stat(target_.c_str(), &old) == 0;
  if (replaces && !S_ISREG(old.st_mode))
    fail(S_ISDIR(old.st_mode) ? "it is a folder, expected a file"
                              : "it is a device, expected a file");
  remove_leftovers(target_);
  // What may not be read by all is never readable under its temporary name either.
  create(replaces ? S_IRUSR | S_IWUSR : 0666);
  if (replaces) ::fchmod(file_, old.st_mode & 07777);
}

AtomicFile::~AtomicFile() {
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
  if (file_ >= 0) ::close(file_);
}

void AtomicFile::create(unsigned mode) {
  for (int tries = 0; tries < most_tries; ++tries) {
    const fs::path name = folder_of(target_) / (temporary_prefix(target_) + random_name());
    file_ = ::open(name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, mode);
    if (file_ < 0 && errno == EEXIST) continue;
    if (file_ < 0) fail(errno);
    // Another writer may have taken it for a leftover before it was locked.
    ::flock(file_, LOCK_EX);
    struct stat status{};
    if (::fstat(file_, &status) == 0 && status.st_nlink > 0) {
      temporary_ = name;
      return;
    }
    ::close(file_);
  }
  file_ = -1;
  fail(EEXIST);
}

void AtomicFile::write(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(file_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail(errno);
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
}

void AtomicFile::replace() {
  if (::fsync(file_) != 0) fail(errno);
  if (::rename(temporary_.c_str(), target_.c_str()) != 0) fail(errno);
  temporary_.clear();
  sync_folder(folder_of(target_));
}

void AtomicFile::fail(const std::string& why) const { throw WriteError(target_.string(), why); }

void AtomicFile::fail(int error) const { fail(std::generic_category().message(error)); }

}  // namespace fusionslam::detail
