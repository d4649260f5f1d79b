// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
// States of maps: refused, or a map that a robot can drive on.
#include <fuzzer/FuzzedDataProvider.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <type_traits>
#include <vector>

#include "fusionslam/errors.hpp"
#include "fusionslam/ratslam/experience_map.hpp"

namespace {

fusionslam::ExperienceMap small_map() {
  fusionslam::ExperienceMap map;
  for (int i = 0; i < 4; ++i) {
    map.on_odometry(1, 0.5, 1);
    map.apply({fusionslam::ActionKind::create_node, i ? i - 1 : 0, i});
  }
  return map;
}

template <class T>
void spoil(FuzzedDataProvider& source, std::vector<T>& values) {
  if (source.ConsumeIntegralInRange(0, 7) == 0) values.resize(source.ConsumeIntegralInRange(0, 40));
  for (T& value : values)
    if (source.ConsumeIntegralInRange(0, 9) == 0) {
      if constexpr (std::is_floating_point_v<T>) {
        value = source.ConsumeBool() ? source.ConsumeFloatingPoint<T>()
                                     : T(source.ConsumeIntegralInRange(-9, 9));
      } else {
        value = source.ConsumeBool() ? source.ConsumeIntegral<T>()
                                     : T(source.ConsumeIntegralInRange(-2, 5));
      }
    }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzedDataProvider source(data, size);
  static const fusionslam::MapState valid = small_map().state();
  fusionslam::MapState state = valid;
  spoil(source, state.nodes);
  spoil(source, state.ends);
  spoil(source, state.links);
  spoil(source, state.loops);
  spoil(source, state.robot);
  spoil(source, state.counts);
  spoil(source, state.due);
  spoil(source, state.pending_ends);
  spoil(source, state.pending);
  spoil(source, state.interruptions);
  fusionslam::ExperienceMap map;
  try {
    map.restore(state);
    for (int i = 0; i < 3; ++i) {
      map.on_odometry(0.5, 0.1, 0.2);
      const std::int64_t target = i % std::int64_t(map.size() + 1);
      const fusionslam::MapAction loop{
          fusionslam::ActionKind::create_edge, map.current(), target, 0.1, 0.2, 0.1};
      if (map.check(loop).accepted) map.apply(loop);
      map.relax(i == 2);
    }
    if (std::isnan(map.pose().x + map.pose().y + map.pose().heading)) std::abort();
  } catch (const fusionslam::DataError&) {
  } catch (const fusionslam::ShapeError&) {
  } catch (const fusionslam::ConfigError&) {
  }
  return 0;
}
