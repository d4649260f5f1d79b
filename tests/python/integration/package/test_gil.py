# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Calls into the core release the GIL."""

import sys
import threading
from collections.abc import Callable

import numpy as np

import fusionslam
from arrays import LEFT, RNG
from rows import rows


def let_others_run(call: Callable[[], object], tries: int) -> bool:
    """True if another Python thread runs within so many calls.

    Nothing but the calls themselves can release the GIL here: Python never takes it from a
    running thread. A busy machine may need more than one call to give the other thread a core.
    """
    go, ran = threading.Event(), []

    def wait_and_note() -> None:
        go.wait()
        ran.append(True)

    thread, interval = threading.Thread(target=wait_and_note), sys.getswitchinterval()
    thread.start()
    sys.setswitchinterval(1000)
    try:
        go.set()
        for _ in range(tries):
            call()
            if ran:
                break
        released = bool(ran)
    finally:
        sys.setswitchinterval(interval)
    thread.join()
    return released


# What NumPy does with these arrays, which would release the GIL, too, is done before the calls.
BIG = np.array(RNG.normal(size=(60_000, 3)) * [20, 8, 2], np.float32)
BIG_COLORS = np.zeros((60_000, 3), np.uint8)
BIG_LEFT = np.tile(LEFT, (20, 12))
SGBM = fusionslam.StereoConfig(method="sgbm")
LONG_CALLS: dict[str, Callable[[], object]] = {
    "m2dp": lambda: fusionslam.m2dp(BIG),
    "cm2dp": lambda: fusionslam.cm2dp(BIG, BIG_COLORS),
    "shot": lambda: fusionslam.shot(BIG[:20_000]),
    "remove_ground_plane": lambda: fusionslam.remove_ground_plane(BIG),
    "voxel_downsample": lambda: fusionslam.voxel_downsample(BIG, size=0.1),
    "nearest_causal": lambda: fusionslam.nearest_causal(BIG[:20_000], window=0, threads=1),
    "stereo_disparity": lambda: fusionslam.stereo_disparity(BIG_LEFT, BIG_LEFT, config=SGBM),
}


@rows("call", LONG_CALLS)
def test_other_threads_run_during_a_long_call(call: str) -> None:
    assert let_others_run(LONG_CALLS[call], tries=1000)


def test_the_check_above_notices_a_call_that_keeps_the_gil() -> None:
    assert not let_others_run(lambda: sum(range(2_000_000)), tries=5)
