# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The stopwatch of nodes, maps and descriptions."""

import numpy as np

from fusionslam.base.timer import Stopwatch


def test_the_durations_of_each_part_are_added_up() -> None:
    watch = Stopwatch()
    for seconds in (0.5, 0.25):
        watch.add("map", seconds)
    with watch.measure("view"):
        pass
    assert watch.total("map") == 0.75 and watch.total("view") > 0 and watch.total("other") == 0


def test_quantiles_are_those_of_the_latest_thousand_durations() -> None:
    watch = Stopwatch()
    assert watch.quantile("latency", 0.5) is None
    durations = np.random.default_rng(1).random(1500)
    for seconds in durations:
        watch.add("latency", seconds)
    assert watch.quantile("latency", 0.95) == np.quantile(durations[500:], 0.95)
