# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pairing scans with images: against brute force on sorted data, for any order of arrival."""

import math
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from error_codes import has_code
from fusionslam.errors import ConfigError, DataError
from fusionslam.sensors.synchronizer import (
    BUFFER_FULL,
    CLOCK_JUMP,
    DUPLICATE,
    LATE,
    NO_IMAGE,
    REASONS,
    Pair,
    SyncConfig,
    Synchronizer,
)
from rows import rows

MS = 1_000_000
Policy = Literal["nearest", "last_before"]
Message = tuple[str, int]  # sensor, stamp in ms

policies = st.sampled_from(["nearest", "last_before"])
stamps = st.sets(st.integers(0, 2000), max_size=40)


def best_image(policy: str, images: set[int], scan: int, reach: int) -> int | None:
    """The stamp of the image that belongs to a scan, by looking at all of them."""
    near = [image for image in images if abs(image - scan) <= reach]
    if policy == "last_before":
        return max((image for image in near if image <= scan), default=None)
    return min(near, key=lambda image: (abs(image - scan), image), default=None)


def offline(
    policy: str, scans: set[int], images: dict[str, set[int]], reach: int
) -> list[tuple[int, dict[str, int | None]]]:
    found = [
        (scan, {name: best_image(policy, own, scan, reach) for name, own in images.items()})
        for scan in sorted(scans)
    ]
    return [(scan, chosen) for scan, chosen in found if None not in chosen.values()]


def seen(pairs: list[Pair]) -> list[tuple[int, dict[str, int]]]:
    """Stamps in ms; the items must be those that came with the stamps."""
    for pair in pairs:
        assert pair.item == ("points", pair.stamp_ns // MS)
        for name, image in pair.images.items():
            assert image.item == (name, image.stamp_ns // MS)
    return [
        (pair.stamp_ns // MS, {name: i.stamp_ns // MS for name, i in pair.images.items()})
        for pair in pairs
    ]


def check(sync: Synchronizer) -> None:
    """The conservation law and the bound, which hold at all times."""
    for sensor in ("points", *sync.cameras):
        dropped = sum(n for (name, _), n in sync.dropped.items() if name == sensor)
        counts = sync.paired[sensor] + sync.unused[sensor] + dropped + sync.waiting[sensor]
        assert sync.added[sensor] == counts
        assert sync.buffered[sensor] <= sync.config.buffer
    assert {reason for _, reason in sync.dropped} <= set(REASONS)
    assert min(sync.dropped.values(), default=1) > 0


def run(sync: Synchronizer, messages: list[Message], *, flush: bool = True) -> list[Pair]:
    pairs: list[Pair] = []
    for sensor, stamp in messages:
        pairs += sync.add(sensor, stamp * MS, (sensor, stamp))
        check(sync)
    if flush:
        pairs += sync.flush()
        check(sync)
        assert not any(sync.waiting.values()) and not any(sync.buffered.values())
    return pairs


@settings(max_examples=100, derandomize=True)
@given(policies, stamps, stamps, stamps, st.integers(0, 300), st.integers(0, 300), st.randoms())
def test_disorder_within_lateness_changes_nothing(
    policy: Any, scans: Any, left: Any, right: Any, reach: Any, late: Any, rng: Any
) -> None:
    images = {"left": left, "right": right}
    messages = [("points", stamp) for stamp in scans]
    messages += [(name, stamp) for name, own in images.items() for stamp in own]
    # Delayed by at most the lateness: none arrives after one that is newer by more.
    messages.sort(key=lambda message: (message[1] + rng.uniform(0, late), message))
    config = SyncConfig(
        policy=policy, max_difference=reach / 1000, lateness=late / 1000, buffer=200, jump=10.0
    )
    sync = Synchronizer(config, cameras=images)
    assert seen(run(sync, messages)) == offline(policy, scans, images, reach)
    assert {reason for _, reason in sync.dropped} <= {NO_IMAGE}


@settings(max_examples=100, derandomize=True)
@given(policies, stamps, stamps, st.integers(0, 300), st.randoms())
def test_sensors_may_lag_at_will(
    policy: Any, scans: Any, images: Any, reach: Any, rng: Any
) -> None:
    """Each sensor in order, as over TCP; the two interleaved in any way."""
    waiting = {"points": sorted(scans), "left": sorted(images)}
    messages: list[Message] = []
    while any(waiting.values()):
        sensor = rng.choice([name for name, left in waiting.items() if left])
        messages.append((sensor, waiting[sensor].pop(0)))
    sync = Synchronizer(SyncConfig(policy=policy, max_difference=reach / 1000, buffer=200))
    assert seen(run(sync, messages)) == offline(policy, scans, {"left": images}, reach)


@settings(max_examples=100, derandomize=True)
@given(
    policies,
    st.lists(st.tuples(st.sampled_from(["points", "left", "right"]), st.integers(0, 9000))),
    st.integers(1, 5),
    st.integers(0, 500),
)
def test_counts_and_bounds_always_hold(policy: Any, messages: Any, buffer: Any, late: Any) -> None:
    config = SyncConfig(policy=policy, buffer=buffer, lateness=late / 1000, jump=3.0)
    sync = Synchronizer(config, cameras=("left", "right"))
    pairs = run(sync, messages)
    assert sync.paired["points"] == len(pairs)
    for pair in pairs:
        for image in pair.images.values():
            assert abs(image.stamp_ns - pair.stamp_ns) <= 100 * MS
            assert policy == "nearest" or image.stamp_ns <= pair.stamp_ns


@rows("policy, chosen", [("nearest", 130), ("last_before", 90)])
def test_the_policies_choose_as_the_thesis_and_its_program_do(policy: Policy, chosen: int) -> None:
    sync = Synchronizer(SyncConfig(policy=policy))
    pairs = run(sync, [("left", 90), ("left", 130), ("points", 120), ("left", 190)])
    assert seen(pairs) == [(120, {"left": chosen})]


def test_a_pair_is_given_out_as_soon_as_no_better_image_can_come() -> None:
    for messages, pairs in (
        ([("left", 90), ("points", 100), ("left", 105)], []),
        # 95 is 5 ms away: what comes after 106 is further away than that.
        ([("left", 95), ("points", 100), ("left", 106)], [(100, {"left": 95})]),
        ([("left", 100), ("points", 100)], [(100, {"left": 100})]),
    ):
        sync = Synchronizer(SyncConfig(policy="nearest"))
        assert seen(run(sync, messages, flush=False)) == pairs


def test_one_image_serves_several_scans_of_a_faster_lidar() -> None:
    sync = Synchronizer(SyncConfig(policy="last_before"))
    pairs = run(sync, [("left", 0), ("points", 10), ("points", 40), ("left", 100)])
    assert [chosen["left"] for _, chosen in seen(pairs)] == [0, 0]
    assert sync.paired == {"points": 2, "left": 1} and sync.unused == {"left": 1}


def test_duplicates_and_late_ones_are_counted_and_change_nothing() -> None:
    sync = Synchronizer(SyncConfig(policy="last_before"))
    messages = [("left", 100), ("left", 100), ("points", 110), ("points", 110), ("left", 120)]
    late = [("points", 110), ("points", 60), ("left", 70), ("points", 130)]
    assert [scan for scan, _ in seen(run(sync, messages + late))] == [110, 130]
    duplicates = {("left", DUPLICATE): 1, ("points", DUPLICATE): 2}
    assert sync.dropped == {**duplicates, ("points", LATE): 1, ("left", LATE): 1}


def test_a_scan_without_an_image_near_it_is_dropped_with_that_reason() -> None:
    sync = Synchronizer(SyncConfig(max_difference=0.05))
    assert not run(sync, [("left", 0), ("points", 100), ("left", 200)])
    assert sync.dropped == {("points", NO_IMAGE): 1} and sync.unused == {"left": 2}


@rows("sensor, other, reason", [("points", "left", NO_IMAGE), ("left", "points", BUFFER_FULL)])
def test_a_sensor_that_died_does_not_fill_the_memory(sensor: str, other: str, reason: str) -> None:
    sync = Synchronizer(SyncConfig(buffer=4))
    assert not run(sync, [(sensor, 100 * n) for n in range(10)], flush=False)
    assert sync.dropped == {(sensor, reason): 6} and sync.waiting == {sensor: 4, other: 0}


def test_a_full_buffer_decides_with_what_is_there() -> None:
    sync = Synchronizer(SyncConfig(buffer=2, lateness=0.9, policy="last_before"))
    messages = [("left", 0), ("points", 10), ("left", 50), ("left", 100)]
    assert seen(run(sync, messages, flush=False)) == [(10, {"left": 0})]


def test_a_clock_that_jumps_back_starts_all_anew() -> None:
    sync = Synchronizer()
    first = [("left", 5000), ("points", 5010), ("points", 5100)]
    again = [("left", 100), ("points", 110), ("left", 200)]
    assert [scan for scan, _ in seen(run(sync, first + again))] == [110]
    assert sync.jumps == 1
    assert sync.dropped == {("points", CLOCK_JUMP): 2, ("left", CLOCK_JUMP): 1}


def test_without_a_lidar_one_camera_leads() -> None:
    sync = Synchronizer(cameras=("right",), scans="left")
    sync.add("left", 100 * MS, "L")
    (pair,) = sync.add("right", 100 * MS, "R")
    assert (pair.item, pair.images["right"].item) == ("L", "R")
    with pytest.raises(ConfigError, match=r"'lidar'.* points, left"):
        Synchronizer().add("lidar", 0, None)


def test_stamps_are_any_integers_and_nothing_else() -> None:
    sync = Synchronizer(SyncConfig(lateness=0.5))
    for stamp in (np.int8(5), np.uint64(6)):
        sync.add("points", stamp, None)
        sync.add("left", stamp, None)
    assert len(sync.flush()) == 2
    with pytest.raises(DataError, check=has_code("stamp", "1.5")):
        sync.add("points", 1.5, None)


@rows("name", ["lateness", "max_difference"])
def test_endless_durations_and_jumps_within_the_lateness_are_refused(name: str) -> None:
    jump = {"jump": math.inf} if name == "lateness" else {}
    config = SyncConfig.model_construct(**{**SyncConfig().model_dump(), name: math.inf, **jump})
    with pytest.raises(ConfigError, check=has_code("out-of-range", name)):
        Synchronizer(config)
    with pytest.raises(ValueError, match=r"jump .*lateness"):
        SyncConfig(lateness=2.0)
