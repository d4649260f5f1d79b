# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A map is saved, copied and exported between two steps, whichever thread asks for it."""

import pickle
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from drives import circle_events, everything, same, take
from fusionslam.ratslam import Look, Motion, RatSlam, Sighting
from fusionslam.ratslam.map_snapshot import LiveMap

OTHERS: list[threading.Thread] = []


class SlowViews:
    """A view source that lets another thread act in the middle of a step."""

    kind = title = "slow"

    def __init__(self, meanwhile: Callable[[], object] | None = None) -> None:
        self.meanwhile, self.known = meanwhile, 0

    def look(self, item: Any, stamp_ns: int) -> Sighting:
        self.known = max(self.known, item + 1)
        if self.meanwhile is not None:
            other = threading.Thread(target=self.meanwhile)
            other.start()
            # The other thread must wait for this step; it is given time to do so wrongly.
            other.join(0.3)
            OTHERS.append(other)
        return Sighting(stamp_ns, item)

    def to_bytes(self) -> bytes:
        return bytes([self.known])

    def restore(self, content: bytes) -> None:
        self.known = content[0]


def begun(views: SlowViews) -> RatSlam:
    slam = RatSlam(views=views)
    for stamp_ns in range(0, 10**9, 10**8):
        slam.step(Motion(stamp_ns, 0.5, 0.1))
    return slam


def test_a_map_is_saved_between_two_steps(tmp_path: Path) -> None:
    views = SlowViews()
    slam = begun(views)
    views.meanwhile = lambda: slam.save(tmp_path / "state.npz")
    slam.step(Look(10**9, 0))
    OTHERS.pop().join()
    saved = RatSlam.load(tmp_path / "state.npz", views=SlowViews())
    assert same(everything(saved), everything(slam))
    assert saved.seen_ns == slam.seen_ns == (9 * 10**8, 10**9)


def test_a_map_is_copied_and_shown_between_two_steps() -> None:
    seen: list[Any] = []
    views = SlowViews()
    slam = begun(views)

    def copy() -> None:
        views.meanwhile = None
        seen.append(pickle.loads(pickle.dumps(slam.__getstate__()["memory"])))
        seen.append(LiveMap.of(slam, "drive", "wheels"))

    views.meanwhile = copy
    slam.step(Look(10**9, 0))
    OTHERS.pop().join()
    memory, shown = seen
    assert memory == slam.memory and len(shown.nodes) == len(shown.node_views) == len(slam.map)


@pytest.mark.parametrize("preset", ["robust", "openratslam"])
def test_every_file_saved_beside_a_stepping_thread_can_be_loaded(
    tmp_path: Path, preset: str
) -> None:
    slam, barrier, done = RatSlam(preset=preset), threading.Barrier(2), threading.Event()
    failed: list[BaseException] = []

    def drive() -> None:
        barrier.wait()
        try:
            take(slam, circle_events(1.3))
        except BaseException as error:
            failed.append(error)
        done.set()

    thread = threading.Thread(target=drive)
    thread.start()
    barrier.wait()
    saves = 0
    while not done.is_set() or saves < 3:
        slam.save(tmp_path / "state.npz")
        saved = RatSlam.load(tmp_path / "state.npz")
        assert len(saved.map) == len(saved.memory.node_views)
        saves += 1
    thread.join()
    assert not failed and len(slam.map) > 5
