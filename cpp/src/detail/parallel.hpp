// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "fusionslam/errors.hpp"
#include "interrupt.hpp"

namespace fusionslam::detail {

/// The number of threads that a `threads` argument asks for. Throws ConfigError if it is negative.
inline std::size_t thread_count(int threads) {
  if (threads < 0)
    throw ConfigError("threads is " + std::to_string(threads) +
                      ", expected 0 (one a core) or more");
  constexpr int most = 1024;  // more would only cost
  if (threads > 0) return static_cast<std::size_t>(std::min(threads, most));
  return std::max<std::size_t>(1, std::thread::hardware_concurrency());
}

/// State shared by the threads of one parallel_for.
class WorkPool {
 public:
  explicit WorkPool(std::size_t count) : count_(count) {}

  /// Does items until there are none left or one failed.
  template <class Work>
  void run(Work&& work) {
    try {
      for (std::size_t i = next_++; i < count_ && !stop_; i = next_++) {
        check_interrupt();
        work(i);
      }
    } catch (...) {
      fail();
    }
  }
  void report_finished() {
    const std::lock_guard lock(mutex_);
    ++finished_;
    changed_.notify_one();
  }
  /// Waits for other threads, looking for an interrupt meanwhile.
  void wait_for(std::size_t threads) {
    std::unique_lock lock(mutex_);
    const auto done = [&] { return finished_ == threads; };
    while (!changed_.wait_for(lock, std::chrono::milliseconds(50), done)) {
      lock.unlock();
      try {
        check_interrupt();
      } catch (...) {
        fail();
      }
      lock.lock();
    }
  }
  void rethrow() const {
    if (failure_) std::rethrow_exception(failure_);
  }
  const std::atomic<bool>& stop() const { return stop_; }

 private:
  void fail() {
    const std::lock_guard lock(mutex_);
    if (!failure_) failure_ = std::current_exception();
    stop_ = true;
  }

  std::size_t count_;
  std::atomic<std::size_t> next_{0};
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t finished_ = 0;
  std::exception_ptr failure_;
};

/// Calls work(i) for i in [0, count) on `threads` threads (0: one a core) that end with the call.
/// The order is free, so work(i) must write to places of its own. Rethrows the first exception.
/// The calling thread looks for an interrupt between its items and while it waits;
/// check_interrupt() inside work(i) notices it on every thread.
template <class Work>
void parallel_for(std::size_t count, int threads, Work&& work) {
  const std::size_t workers = std::min(thread_count(threads), count);
  WorkPool pool(count);
  if (workers <= 1) {
    pool.run(work);
    pool.rethrow();
    return;
  }
  {
    std::vector<std::jthread> helpers;
    helpers.reserve(workers - 1);
    try {
      for (std::size_t i = 1; i < workers; ++i)
        helpers.emplace_back([&] {
          const PoolThread mark(pool.stop());
          pool.run(work);
          pool.report_finished();
        });
    } catch (const std::system_error&) {
      // The system gives no more threads: those that there are do the work.
    }
    pool.run(work);
    pool.wait_for(helpers.size());
  }
  pool.rethrow();
}

}  // namespace fusionslam::detail
