# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Other threads run during calls into the core."""

import sys
import threading
from collections.abc import Callable

import numpy as np
import pytest

import fusionslam
from array_calls import LEFT, RNG


def runs_beside(call: Callable[[], object]) -> bool:
    """Whether another Python thread gets to run before a call returns.

    Python never takes the GIL from a running thread here, so the call must give it away.
    """
    go, ran = threading.Event(), []

    def wait_and_note() -> None:
        go.wait()
        ran.append(True)

    thread, interval = threading.Thread(target=wait_and_note), sys.getswitchinterval()
    sys.setswitchinterval(1000)
    try:
        thread.start()
        go.set()
        call()
        beside = bool(ran)
    finally:
        sys.setswitchinterval(interval)
    thread.join()
    return beside


BIG = RNG.normal(size=(60_000, 3)).astype(np.float32) * [20, 8, 2]
BIG_COLORS = np.zeros((60_000, 3), np.uint8)
LONG_CALLS: dict[str, Callable[[], object]] = {
    "m2dp": lambda: fusionslam.m2dp(BIG),
    "cm2dp": lambda: fusionslam.cm2dp(BIG, BIG_COLORS),
    "shot": lambda: fusionslam.shot(BIG[:20_000]),
    "remove_ground_plane": lambda: fusionslam.remove_ground_plane(BIG),
    "voxel_downsample": lambda: fusionslam.voxel_downsample(BIG, size=0.1),
    "nearest_causal": lambda: fusionslam.nearest_causal(BIG[:20_000], window=0, threads=1),
    "stereo_disparity": lambda: fusionslam.stereo_disparity(
        *[np.tile(LEFT, (20, 12))] * 2, config=fusionslam.StereoConfig(method="sgbm")
    ),
}


@pytest.mark.parametrize("call", LONG_CALLS)
def test_other_threads_run_during_a_long_call(call: str) -> None:
    # On a busy machine the other thread may not get a core in time.
    assert any(runs_beside(LONG_CALLS[call]) for _ in range(5))


def test_the_check_above_notices_a_call_that_keeps_the_gil() -> None:
    assert not runs_beside(lambda: sum(range(2_000_000)))
