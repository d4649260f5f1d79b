// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <string>
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

/// Calls work(i) for i in [0, count) on `threads` threads (0: one a core) that end with the call.
/// The order is free, so work(i) must write to places of its own. Rethrows the first exception;
/// between two items of its own the calling thread looks for an interrupt.
template <class Work>
void parallel_for(std::size_t count, int threads, Work&& work) {
  const std::size_t workers = std::min(thread_count(threads), count);
  if (workers <= 1) {
    for (std::size_t i = 0; i < count; ++i) {
      check_interrupt();
      work(i);
    }
    return;
  }
  std::atomic<std::size_t> next{0};
  std::exception_ptr failure;
  std::mutex failure_mutex;
  const auto loop = [&] {
    try {
      for (std::size_t i = next++; i < count; i = next++) {
        check_interrupt();  // does nothing on the threads of the pool, which have no scope
        work(i);
      }
    } catch (...) {
      const std::lock_guard lock(failure_mutex);
      if (!failure) failure = std::current_exception();
      next = count;
    }
  };
  {
    std::vector<std::jthread> pool;
    for (std::size_t i = 1; i < workers; ++i) pool.emplace_back(loop);
    loop();
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace fusionslam::detail
