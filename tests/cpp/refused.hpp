// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <doctest/doctest.h>

#include <string>
#include <string_view>

namespace fusionslam::testing {

/// The call throws an `Error` (or one derived from it), and its message contains `words`.
template <class Error, class Call>
void check_refused(Call&& call, std::string_view words) {
  bool thrown = false;
  std::string message;
  try {
    call();
  } catch (const Error& error) {
    thrown = true;
    message = error.what();
  }
  INFO("expected: ", std::string(words));
  INFO("message: ", message);
  CHECK(thrown);
  CHECK(message.find(words) != std::string::npos);
}

}  // namespace fusionslam::testing
