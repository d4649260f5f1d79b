// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "interrupt.hpp"

#include <atomic>
#include <chrono>
#include <utility>

namespace fusionslam {
namespace {

thread_local std::function<bool()> interrupt_wanted;
thread_local const std::atomic<bool>* stop_of_pool = nullptr;
// NOLINTNEXTLINE(bugprone-throwing-static-initialization): nothing runs that could throw.
constinit thread_local std::chrono::steady_clock::time_point next_question{};

}  // namespace

InterruptScope::InterruptScope(std::function<bool()> wanted)
    : outer_(std::exchange(interrupt_wanted, std::move(wanted))) {}

InterruptScope::~InterruptScope() { interrupt_wanted = std::move(outer_); }

detail::PoolThread::PoolThread(const std::atomic<bool>& stop) { stop_of_pool = &stop; }
detail::PoolThread::~PoolThread() { stop_of_pool = nullptr; }

void detail::check_interrupt() {
  if (stop_of_pool != nullptr && *stop_of_pool) throw Interrupted("interrupted");
  if (!interrupt_wanted) return;
  const auto now = std::chrono::steady_clock::now();
  if (now < next_question) return;
  next_question = now + std::chrono::milliseconds(20);
  const auto wanted = interrupt_wanted;  // it may itself come here with a scope of its own
  if (wanted()) throw Interrupted("interrupted");
}

}  // namespace fusionslam
