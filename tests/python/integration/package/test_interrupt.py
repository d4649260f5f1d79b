# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C, or any other signal whose handler raises, ends calls into the core."""

import signal
from collections.abc import Callable, Iterator
from types import FrameType

import numpy as np
import pytest

import fusionslam
from fusionslam import views
from fusionslam.base.files import delay_interrupts
from rows import rows
from scenes import random_scene


class Alarm(Exception):
    """What the handler of the tests raises."""


def handler(number: int, frame: FrameType | None) -> None:
    raise Alarm


@pytest.fixture(autouse=True)
def alarm_handler() -> Iterator[None]:
    before = signal.signal(signal.SIGALRM, handler)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


RANDOM = np.random.default_rng(1)
CLOUD = RANDOM.normal(size=(2_000_000, 3)).astype(np.float32)
COLORS = RANDOM.integers(0, 256, CLOUD.shape, dtype=np.uint8)
TABLE = RANDOM.random((6000, 576), dtype=np.float32)
IMAGE = np.zeros((375, 1242, 3), np.uint8)
PROJECTION = np.array([[50, 0, 600, 0], [0, 50, 180, 0], [0, 0, 1, 9]], float)
SCENE = random_scene(RANDOM, 20_000)
SCENES = views.SceneIndex(views.SimilarityConfig(color_difference="ciede2000"))
SCENES.add(SCENE)

# Each takes far longer than the alarm needs, on any machine and level.
LONG: dict[str, Callable[[], object]] = {
    "m2dp": lambda: [fusionslam.m2dp(CLOUD) for _ in range(20)],
    "cm2dp": lambda: fusionslam.cm2dp(CLOUD, COLORS, color_space="lab"),
    "cloud_resolution": lambda: fusionslam.cloud_resolution(CLOUD),
    "estimate_normals": lambda: fusionslam.estimate_normals(CLOUD, radius=0.1),
    "estimate_normals, all neighbours": lambda: fusionslam.estimate_normals(CLOUD, radius=1e6),
    "estimate_normals, threads": lambda: fusionslam.estimate_normals(CLOUD, radius=0.1, threads=3),
    "cshot": lambda: fusionslam.cshot(CLOUD, COLORS, normal_radius=0.1),
    "colorize": lambda: [fusionslam.colorize(CLOUD, IMAGE, PROJECTION) for _ in range(20)],
    "voxel_downsample": lambda: fusionslam.voxel_downsample(CLOUD, size=0.01),
    "remove_ground_plane": lambda: fusionslam.remove_ground_plane(CLOUD),
    "nearest_causal": lambda: fusionslam.nearest_causal(TABLE, window=0, k=5),
    "scene_similarity": lambda: views.scene_similarity(SCENE, SCENE),
    "similarities": lambda: SCENES.similarities(SCENE),
}


@rows("name", LONG)
def test_a_signal_ends_a_long_call(name: str) -> None:
    with pytest.raises(Alarm):  # which may ring before the call, on a busy machine
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        LONG[name]()


def test_after_an_interrupt_the_same_call_works() -> None:
    with pytest.raises(Alarm):  # which may ring before the call, on a busy machine
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        LONG["nearest_causal"]()
    few = TABLE[:50]
    expected = np.argmin(np.linalg.norm(few[:-1] - few[-1], axis=1))
    assert fusionslam.nearest_causal(few, window=0, k=1)[0][-1, 0] == expected


def test_what_others_write_is_not_cut_in_the_middle() -> None:
    # Where tests run in the background, SIGINT may be ignored.
    before = signal.signal(signal.SIGINT, handler)
    done = []
    try:
        with pytest.raises(Alarm), delay_interrupts():
            signal.raise_signal(signal.SIGINT)
            done.append("the rest")
        assert done == ["the rest"]
        assert signal.getsignal(signal.SIGINT) is handler
    finally:
        signal.signal(signal.SIGINT, before)
