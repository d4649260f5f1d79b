// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>

#include "fusionslam/interrupt.hpp"

namespace fusionslam::detail {

/// Throws Interrupted if the thread's InterruptScope asks for it. Cheap: asks at most every 20 ms,
/// so loops may call it as often as every few microseconds of work.
void check_interrupt();

/// While it lives, check_interrupt() on this thread throws once `stop` is set: for the threads of a
/// pool, which have no scope of their own.
class PoolThread {
 public:
  explicit PoolThread(const std::atomic<bool>& stop);
  ~PoolThread();
  PoolThread(const PoolThread&) = delete;
  PoolThread& operator=(const PoolThread&) = delete;
};

}  // namespace fusionslam::detail
