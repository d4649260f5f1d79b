// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <stdexcept>

namespace fusionslam {

/// A call was given up because its InterruptScope asked for it; nothing was changed.
struct Interrupted : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// While it lives, long calls of this thread ask `wanted` several times a second, from this thread,
/// and throw Interrupted once it answers true. Scopes nest; the innermost one is asked.
class InterruptScope {
 public:
  explicit InterruptScope(std::function<bool()> wanted);
  ~InterruptScope();
  InterruptScope(const InterruptScope&) = delete;
  InterruptScope& operator=(const InterruptScope&) = delete;

 private:
  std::function<bool()> outer_;
};

}  // namespace fusionslam
