// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <limits>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>

#include "fusionslam/errors.hpp"

namespace fusionslam {

/// Help text, unit and range of a configuration value.
struct OptionInfo {
  const char* help = "";
  const char* unit = "";
  double minimum = std::numeric_limits<double>::lowest();
  double maximum = std::numeric_limits<double>::max();
};

/// The names of an enumeration's values, in order; specialised beside each enumeration.
template <class Enum>
struct ChoiceNames;

template <class Enum>
std::string_view choice_name(Enum value) {
  return ChoiceNames<Enum>::value.at(static_cast<std::size_t>(value));
}

/// Throws ConfigError, with the known names, if `name` is none of them.
template <class Enum>
Enum choice_from_name(std::string_view key, std::string_view name) {
  const auto& names = ChoiceNames<Enum>::value;
  std::string known;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (names[i] == name) return static_cast<Enum>(i);
    known += (i ? ", " : "") + std::string(names[i]);
  }
  throw ConfigError(std::string(key) + " is '" + std::string(name) + "', expected one of " + known);
}

/// Checks every number of `config` against its range; throws ConfigError naming the first one
/// out of range.
template <class Config>
void validate(const Config& config) {
  Config::visit(config, [](const char* name, const auto& value, const OptionInfo& info) {
    using Value = std::decay_t<decltype(value)>;
    if constexpr (std::is_arithmetic_v<Value> && !std::is_same_v<Value, bool>) {
      if (value >= info.minimum && value <= info.maximum) return;
      std::ostringstream message;
      message << Config::section << '.' << name << " is " << value << ", expected " << info.minimum
              << " to " << info.maximum;
      throw ConfigError(message.str());
    }
  });
}

}  // namespace fusionslam
