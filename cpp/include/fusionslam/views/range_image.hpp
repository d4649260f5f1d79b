// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "fusionslam/config.hpp"
#include "fusionslam/sensors.hpp"

namespace fusionslam {

/// Parameters of a range image. Directions are seen from the sensor, whose position is given in the
/// frame of the cloud; the defaults suit a small robot's frame.
struct RangeImageConfig {
  static constexpr const char* section = "range_image";

  static constexpr double least_step = 0.1;  ///< deg
  static constexpr double most_step = 30;    ///< deg

  double azimuth_step = 1.0;
  double elevation_step = 2.0;
  double sensor_x = 0.0;
  double sensor_y = 0.0;
  double sensor_z = 0.17;
  double longest_range = 30.0;

  template <class Config, class Visitor>
  static void visit(Config& config, Visitor&& visitor) {
    visitor("azimuth_step", config.azimuth_step,
            OptionInfo{"width of a cell", "deg", least_step, most_step});
    visitor("elevation_step", config.elevation_step,
            OptionInfo{"height of a cell", "deg", least_step, most_step});
    visitor("sensor_x", config.sensor_x,
            OptionInfo{"position of the sensor in the frame of the cloud", "m", -1e3, 1e3});
    visitor("sensor_y", config.sensor_y,
            OptionInfo{"position of the sensor in the frame of the cloud", "m", -1e3, 1e3});
    visitor("sensor_z", config.sensor_z,
            OptionInfo{"position of the sensor in the frame of the cloud", "m", -1e3, 1e3});
    visitor("longest_range", config.longest_range,
            OptionInfo{"points beyond are left out", "m", 0.1, 130});
  }
};

/// Range and colour of the nearest surface in each direction in which a cloud has points.
struct RangeImage {
  static constexpr double range_step = 0.01;  ///< m, about the noise of a range
  static constexpr int color_step = 8;        ///< of 256: colours are its multiples

  /// A direction: column and row count steps of azimuth and elevation from straight ahead.
  struct Cell {
    std::int16_t column = 0;              ///< azimuth, to the left
    std::int16_t row = 0;                 ///< elevation, up
    std::uint16_t range = 0;              ///< in steps of range_step: mean of the nearest surface
    std::array<std::uint8_t, 3> color{};  ///< RGB: mean of the same points, in whole color_steps

    bool operator==(const Cell&) const = default;
  };

  float azimuth_step = 0;         ///< deg
  float elevation_step = 0;       ///< deg
  std::array<float, 3> sensor{};  ///< m, in the frame of the cloud
  std::vector<Cell> cells;        ///< in the order of rows, then columns

  bool operator==(const RangeImage&) const = default;

  /// True if a configuration may have these steps.
  bool has_possible_steps() const {
    const auto possible = [](float step) {
      return step >= static_cast<float>(RangeImageConfig::least_step) &&
             step <= static_cast<float>(RangeImageConfig::most_step);
    };
    return possible(azimuth_step) && possible(elevation_step);
  }
};

/// Throws DataError for an image that range_image() cannot return: steps or places out of range,
/// cells out of order, colours between the steps.
void check_range_image(const RangeImage& image);

/// The range image of a coloured cloud. Throws as build_scene.
RangeImage range_image(PointsView points, ColorsView colors, const RangeImageConfig& config = {});

}  // namespace fusionslam
