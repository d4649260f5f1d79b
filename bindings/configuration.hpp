// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// The one file that owns how configurations of the core become classes of Python.
#pragma once

#include <string>
#include <type_traits>

#include "common.hpp"

namespace fusionslam::bindings {

using Options = py::KWArgs<py::object>;
using ConfigState = py::typing::Dict<py::str, py::object>;
using OptionTable = py::typing::List<py::typing::Dict<py::str, py::object>>;

/// Python value of an option: enumerations are their names.
template <class Value>
py::object option_to_python(const Value& value) {
  if constexpr (std::is_enum_v<Value>)
    return py::str(std::string(choice_name(value)));
  else
    return py::cast(value);
}

template <class Value>
void option_from_python(const char* section, const char* name, py::handle given, Value& value) {
  const std::string key = std::string(section) + '.' + name;
  try {
    if constexpr (std::is_enum_v<Value>)
      value = choice_from_name<Value>(key, py::cast<std::string>(given));
    else if (std::is_same_v<Value, bool> != py::isinstance<py::bool_>(given))
      throw py::cast_error();
    else
      value = py::cast<Value>(given);
  } catch (const py::cast_error&) {
    constexpr const char* expected = std::is_same_v<Value, bool>       ? "true or false"
                                     : std::is_integral_v<Value>       ? "a whole number"
                                     : std::is_floating_point_v<Value> ? "a number"
                                                                       : "a name";
    throw ConfigError(key + " is " + py::repr(given).cast<std::string>() + ", expected " +
                      expected);
  }
}

template <class Config>
std::string option_names() {
  std::string names;
  Config config;
  Config::visit(config, [&](const char* name, const auto&, const OptionInfo&) {
    names += (names.empty() ? "" : ", ") + std::string(name);
  });
  return names;
}

/// Sets the named options and checks the whole configuration.
template <class Config>
Config with_options(Config config, const Options& options) {
  for (const auto& [key, given] : options) {
    const std::string wanted = py::str(key);
    bool known = false;
    Config::visit(config, [&](const char* name, auto& value, const OptionInfo&) {
      if (wanted != name) return;
      option_from_python(Config::section, name, given, value);
      known = true;
    });
    if (!known)
      throw ConfigError(std::string(Config::section) + " has no option '" + wanted +
                        "'; known: " + option_names<Config>());
  }
  validate(config);
  return config;
}

template <class Value>
constexpr const char* option_kind() {
  if constexpr (std::is_same_v<Value, bool>)
    return "bool";
  else if constexpr (std::is_integral_v<Value>)
    return "int";
  else if constexpr (std::is_floating_point_v<Value>)
    return "float";
  else
    return "choice";
}

/// Options from which config.py builds a section: name, kind, default, help, unit, range or
/// choices.
template <class Config>
OptionTable describe_options() {
  OptionTable options;
  Config config;
  Config::visit(config, [&](const char* name, const auto& value, const OptionInfo& info) {
    using Value = std::decay_t<decltype(value)>;
    py::dict option;
    option["name"] = name;
    option["kind"] = option_kind<Value>();
    option["default"] = option_to_python(value);
    option["help"] = info.help;
    option["unit"] = info.unit;
    if constexpr (std::is_enum_v<Value>) {
      py::list choices;
      for (const auto choice : ChoiceNames<Value>::value) choices.append(std::string(choice));
      option["choices"] = choices;
    } else if constexpr (!std::is_same_v<Value, bool>) {
      option["minimum"] = info.minimum;
      option["maximum"] = info.maximum;
    }
    options.append(option);
  });
  return options;
}

template <class Config>
ConfigState state_of_config(const Config& config) {
  ConfigState state;
  Config::visit(config, [&](const char* name, const auto& value, const OptionInfo&) {
    state[name] = option_to_python(value);
  });
  return state;
}

template <class Config>
Config config_from_state(const py::object& state) {
  if (!py::isinstance<py::dict>(state) || py::len(state) != py::len(state_of_config(Config{})))
    throw DataError(std::string("state of a configuration: expected every option of ") +
                    Config::section);
  return with_options(Config{}, py::reinterpret_borrow<Options>(state));
}

/// Binds an immutable configuration: keyword arguments in, read-only attributes out.
template <class Config>
py::class_<Config> bind_config(py::module_& module, const char* name, const char* doc) {
  py::class_<Config> bound(module, name, doc);
  Config config;
  Config::visit(config, [&](const char* option, const auto& value, const OptionInfo& info) {
    using Value = std::decay_t<decltype(value)>;
    const auto get = [option = std::string(option)](const Config& self) {
      py::object result;
      Config::visit(self, [&](const char* other, const auto& current, const OptionInfo&) {
        if (option == other) result = option_to_python(current);
      });
      if constexpr (std::is_enum_v<Value>)
        return result.template cast<std::string>();
      else
        return result.template cast<Value>();
    };
    const std::string unit = *info.unit ? std::string(" [") + info.unit + "]" : "";
    bound.def_property_readonly(option, get, (info.help + unit).c_str());
  });
  bound.def_static("options", &describe_options<Config>,
                   "Every option: name, kind, default, help, unit, range or choices.");
  bound.def(py::pickle(&state_of_config<Config>, &config_from_state<Config>));
  bound.def("__repr__", [name = std::string(name)](const Config& self) {
    std::string text;
    Config::visit(self, [&](const char* option, const auto& value, const OptionInfo&) {
      text += (text.empty() ? "" : ", ") + std::string(option) + "=" +
              py::repr(option_to_python(value)).template cast<std::string>();
    });
    return name + "(" + text + ")";
  });
  return bound;
}

}  // namespace fusionslam::bindings
