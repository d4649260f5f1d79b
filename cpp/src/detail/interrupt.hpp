// SPDX-FileCopyrightText: 2026 The fusionslam authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "fusionslam/interrupt.hpp"

namespace fusionslam::detail {

/// Throws Interrupted if the thread's InterruptScope asks for it. Cheap: asks at most every 20 ms,
/// so loops may call it as often as every few microseconds of work.
void check_interrupt();

}  // namespace fusionslam::detail
