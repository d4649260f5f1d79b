// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// An index of the core that threads of Python share.
#pragma once

#include <mutex>
#include <shared_mutex>
#include <utility>

#include "common.hpp"

namespace fusionslam::bindings {

/// An index that Python threads may share: queries run without the GIL, so it cannot guard them.
/// Ctrl-C ends long reads. Python's signal handlers run inside them, on the thread that holds the
/// lock: such a handler may read the same index without a lock, and cannot write to it.
template <class Index>
class SharedIndex {
 public:
  explicit SharedIndex(Index index) : index_(std::move(index)) {}

  /// Calls work(index) without the GIL, while nobody writes.
  template <class Work>
  auto read(Work&& work) const {
    return without_gil([&] {
      std::shared_lock lock(mutex_, std::defer_lock);
      if (!is_read_here()) lock.lock();
      const Reading reading(this);
      return work(index_);
    });
  }

  /// Calls work(index) without the GIL, alone.
  template <class Work>
  auto write(Work&& work) {
    if (is_read_here())
      throw std::runtime_error("a signal handler cannot change the index whose use it interrupts");
    const GilRelease release;
    const std::unique_lock lock(mutex_);
    return work(index_);
  }

  /// As write(), but Ctrl-C ends it: `work` leaves the index consistent wherever it is interrupted.
  /// A signal's handler then reads the index in the middle of the work.
  template <class Work>
  auto write_long(Work&& work) {
    if (is_read_here())
      throw std::runtime_error("a signal handler cannot change the index whose use it interrupts");
    return without_gil([&] {
      const std::unique_lock lock(mutex_);
      const Reading reading(this);
      return work(index_);
    });
  }

 private:
  /// While it lives, this thread reads an index; they form a list, the innermost first.
  struct Reading {
    explicit Reading(const SharedIndex* read) : index(read), outer(readings_) { readings_ = this; }
    Reading(const Reading&) = delete;
    Reading& operator=(const Reading&) = delete;
    ~Reading() { readings_ = outer; }

    const SharedIndex* index;
    const Reading* outer;
  };

  bool is_read_here() const {
    for (const Reading* reading = readings_; reading != nullptr; reading = reading->outer)
      if (reading->index == this) return true;
    return false;
  }

  static inline thread_local const Reading* readings_ = nullptr;
  Index index_;
  mutable std::shared_mutex mutex_;
};

}  // namespace fusionslam::bindings
