# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The same events give the same map to the last bit, however and whenever they arrive."""

import time
from pathlib import Path

import numpy as np
import pytest

from fusionslam.geometry.odometry_noise import OdometryConfig
from fusionslam.ratslam import RatSlam, StampOrder
from fusionslam.ratslam.events import Event
from slam_drives import circle_events, everything, same, take

NOISE = OdometryConfig(speed_noise=0.02, turn_noise=0.02, seed=5)


@pytest.fixture(scope="module")
def events() -> list[Event]:
    return circle_events(1.3)


@pytest.fixture(scope="module")
def whole(events: list[Event]) -> RatSlam:
    slam = RatSlam()
    take(slam, events)
    return slam


def shuffled(events: list[Event], delay_s: float, seed: int) -> list[Event]:
    """In order of arrival: each event up to ``delay_s`` after its stamp."""
    delays = np.random.default_rng(seed).uniform(0, delay_s * 1e9, len(events))
    arrivals = np.array([event.stamp_ns for event in events]) + delays
    return [events[k] for k in np.argsort(arrivals, kind="stable")]


@pytest.mark.parametrize("preset", ["robust", "openratslam"])
def test_two_runs_save_the_same_bytes(tmp_path: Path, preset: str) -> None:
    files = []
    for name in ("one.npz", "two.npz"):
        slam = RatSlam(preset=preset)
        take(slam, circle_events(0.6, NOISE))
        slam.save(tmp_path / name)
        files.append((tmp_path / name).read_bytes())
    assert files[0] == files[1]


def test_another_seed_gives_another_map() -> None:
    maps = []
    for seed in (5, 6):
        slam = RatSlam()
        take(slam, circle_events(0.3, NOISE.model_copy(update={"seed": seed})))
        maps.append(slam.map.nodes)
    assert maps[0].shape == maps[1].shape and not np.array_equal(*maps)


@pytest.mark.parametrize(("delay_s", "seed"), [(0.0, 0), (0.04, 1), (0.2, 2), (0.49, 3)])
def test_events_that_arrive_late_give_the_same_map(
    events: list[Event], whole: RatSlam, delay_s: float, seed: int
) -> None:
    slam, order = RatSlam(), StampOrder(wait=0.5)
    for event in shuffled(events, delay_s, seed):
        take(slam, order.add(event))
    take(slam, order.flush())
    assert order.too_late == 0
    assert same(everything(slam), everything(whole))


@pytest.mark.parametrize("batch", [7, 100, 10_000])
def test_events_in_batches_give_the_same_map(
    events: list[Event], whole: RatSlam, batch: int
) -> None:
    slam, order = RatSlam(), StampOrder(wait=2.0)
    rng = np.random.default_rng(batch)
    for start in range(0, len(events), batch):
        # Within 2 s, whatever arrives together arrives in any order.
        together = events[start : start + batch]
        if together[-1].stamp_ns - together[0].stamp_ns < 1.9e9:
            together = [together[k] for k in rng.permutation(len(together))]
        for event in together:
            take(slam, order.add(event))
    take(slam, order.flush())
    assert same(everything(slam), everything(whole))


def test_the_time_of_day_and_its_pace_do_not_matter(
    events: list[Event], whole: RatSlam, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = iter(range(10**9))
    for name in ("time", "perf_counter", "monotonic"):
        monkeypatch.setattr(time, name, lambda: float(next(slow) * 1000))
    slam = RatSlam()
    take(slam, events)
    monkeypatch.undo()
    assert same(everything(slam), everything(whole))
