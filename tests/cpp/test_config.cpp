// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#include <doctest/doctest.h>

#include <limits>
#include <set>

#include "fusionslam/fusionslam.hpp"
#include "refused.hpp"

namespace fusionslam {
namespace {

using testing::check_refused;

template <class Value>
constexpr bool is_number = std::is_arithmetic_v<Value> && !std::is_same_v<Value, bool>;

/// Every number of the configuration, just past either end of its range, is refused by name.
template <class Config>
void check_ranges() {
  Config reference;
  Config::visit(reference, [](const char* name, auto& first, const OptionInfo& info) {
    using Value = std::decay_t<decltype(first)>;
    if constexpr (is_number<Value>) {
      for (const double wrong : {info.minimum - 1, info.maximum + 1}) {
        Config config;
        Config::visit(config, [&](const char* other, auto& value, const OptionInfo&) {
          if constexpr (is_number<std::decay_t<decltype(value)>>)
            if (std::string(name) == other) value = static_cast<Value>(wrong);
        });
        const std::string key = std::string(Config::section) + "." + name;
        check_refused<ConfigError>([&] { validate(config); }, key + " is ");
      }
    }
  });
}

template <class Config>
void check_names_and_help() {
  Config config;
  std::set<std::string> names;
  Config::visit(config, [&](const char* name, const auto&, const OptionInfo& info) {
    CHECK(names.insert(name).second);
    CHECK(std::string(info.help) != "");
    CHECK(info.minimum <= info.maximum);
  });
  CHECK_NOTHROW(validate(config));
}

TEST_CASE("a number out of range is refused by section and key") {
  check_ranges<M2dpConfig>();
  check_ranges<StereoConfig>();
  check_ranges<GroundPlaneConfig>();
}

TEST_CASE("every option has one name and a help text, and the defaults are valid") {
  check_names_and_help<M2dpConfig>();
  check_names_and_help<StereoConfig>();
  check_names_and_help<GroundPlaneConfig>();
}

TEST_CASE("a configuration that is not a number is refused") {
  GroundPlaneConfig config;
  config.distance = std::numeric_limits<double>::quiet_NaN();
  check_refused<ConfigError>([&] { validate(config); }, "ground.distance is nan");
}

TEST_CASE("choices are found by name, and the error lists them") {
  CHECK(choice_from_name<UpAxis>("up", "-y") == UpAxis::minus_y);
  CHECK(choice_name(UpAxis::minus_z) == "-z");
  CHECK(choice_name(choice_from_name<ColorSpace>("color_space", "lab")) == "lab");
  check_refused<ConfigError>([] { choice_from_name<ColorSpace>("color_space", "cmyk"); },
                             "color_space is 'cmyk', expected one of rgb, hsv, lab");
}

TEST_CASE("the presets of M2DP keep its lengths, and another name is refused") {
  for (const char* name : {"paper", "author", "robust"}) {
    const M2dpConfig config = m2dp_preset(name);
    CHECK_NOTHROW(validate(config));
    CHECK(config.planes() == 64);
    CHECK(config.shape_columns() == 128);
    CHECK(config.color_columns() == 384);
  }
  check_refused<ConfigError>([] { m2dp_preset("best"); }, "'best'");
}

TEST_CASE("functions check the configuration they are given") {
  const std::vector<float> points{0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3};
  const PointsView view{points.data(), 4};
  M2dpConfig m2dp_config;
  m2dp_config.rings = 0;
  check_refused<ConfigError>([&] { m2dp(view, m2dp_config); }, "m2dp.rings is 0");
  GroundPlaneConfig ground;
  ground.max_tilt = 91;
  check_refused<ConfigError>([&] { remove_ground_plane(view, UpAxis::z, ground); },
                             "ground.max_tilt is 91");
  check_refused<ConfigError>([&] { estimate_normals(view, -1); }, "normal_radius");
}

}  // namespace
}  // namespace fusionslam
