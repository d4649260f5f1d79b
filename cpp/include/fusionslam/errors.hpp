// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stdexcept>
#include <string>

namespace fusionslam {

/// The data cannot be used; the message names the file, offset or point.
struct DataError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A file cannot be written; the message names it and the reason.
class WriteError : public DataError {
 public:
  WriteError(const std::string& path, const std::string& why)
      : DataError("cannot write " + path + ": " + why), path_(path) {}
  const std::string& path() const noexcept { return path_; }

 private:
  std::string path_;
};

/// A configuration value is wrong; the message names the key and what was expected.
struct ConfigError : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

/// An array has the wrong length or shape; the message names the argument.
struct ShapeError : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

}  // namespace fusionslam
