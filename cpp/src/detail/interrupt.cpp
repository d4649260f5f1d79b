// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include "interrupt.hpp"

#include <chrono>
#include <utility>

namespace fusionslam {
namespace {

thread_local std::function<bool()> interrupt_wanted;
thread_local std::chrono::steady_clock::time_point next_question;

}  // namespace

InterruptScope::InterruptScope(std::function<bool()> wanted)
    : outer_(std::exchange(interrupt_wanted, std::move(wanted))) {}

InterruptScope::~InterruptScope() { interrupt_wanted = std::move(outer_); }

void detail::check_interrupt() {
  if (!interrupt_wanted) return;
  const auto now = std::chrono::steady_clock::now();
  if (now < next_question) return;
  next_question = now + std::chrono::milliseconds(20);
  if (interrupt_wanted()) throw Interrupted("interrupted");
}

}  // namespace fusionslam
