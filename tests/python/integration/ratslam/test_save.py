# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Saved runs resume bit for bit, equal input gives equal maps, whichever threads ask for them."""

import errno
import io
import json
import os
import pickle
import threading
import time
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drives import SECOND, circle_events, circles, everything, in_order, odometry, same, take
from fusionslam.errors import DataError
from fusionslam.geometry.odometry_noise import OdometryConfig
from fusionslam.ratslam import (
    Look,
    MatcherSource,
    Motion,
    RatSlam,
    Sighting,
    StampOrder,
    TemplateSource,
)
from fusionslam.ratslam.events import Event
from fusionslam.ratslam.map_snapshot import LiveMap
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.recognisers import ViewMatcherConfig
from rows import rows
from scenes import LAPS, place
from stored import change_archive
from threads import run_together

PRESETS = ("robust", "openratslam")


def images(number: int, visit: int) -> np.ndarray:
    rng = np.random.default_rng([3, number])
    blocks = rng.integers(0, 256, (10, 12))
    noise = np.random.default_rng([4, number, visit]).integers(-3, 4, (100, 120))
    return np.clip(np.kron(blocks, np.ones((10, 10))) + noise, 0, 255).astype(np.uint8)


def looks(item: Callable[[int, int], Any]) -> list[Event]:
    stamps = range(SECOND, (len(LAPS) + 1) * SECOND, SECOND)
    seen = zip(stamps, LAPS, strict=True)
    return [Look(stamp_ns, item(number, visit)) for visit, (stamp_ns, number) in enumerate(seen)]


def matcher(**values: Any) -> MatcherSource:
    return MatcherSource(ViewMatcher(ViewMatcherConfig(**values)))


SOURCES: dict[str, tuple[Callable[[], Any], Callable[[int, int], Any]]] = {
    "visual": (lambda: TemplateSource(bottom=100), images),
    "alignment": (lambda: matcher(method="alignment"), place),
    "alignment, several": (
        lambda: matcher(method="alignment", policy="several", store_below=1.0),
        place,
    ),
    "objects": (lambda: matcher(method="objects"), place),
    "cm2dp": (lambda: matcher(method="cm2dp", max_distance=0.3), place),
}


def drive(name: str) -> tuple[Callable[[], RatSlam], list[Event]]:
    """Builder of a RatSlam, and its events: odometry and views of a source or given ids."""
    if name in PRESETS:
        return lambda: RatSlam(preset=name), circle_events(1.1)
    make, item = SOURCES[name]
    way = odometry(circles(0.5), rate_hz=10.0)
    events = in_order(way, [look for look in looks(item) if look.stamp_ns < way[-1].stamp_ns])
    return lambda: RatSlam(views=make()), events


@pytest.mark.slow
@rows("name", [*SOURCES, *PRESETS])
def test_a_resumed_run_equals_the_uninterrupted_one(tmp_path: Path, name: str) -> None:
    make, events = drive(name)
    whole = make()
    steps = take(whole, events)
    assert len({step.view_id for step in steps if step.looked}) > 3
    slam, path = make(), tmp_path / "state.npz"
    slam.save(path)
    slam = RatSlam.load(path)
    continued = []
    part = len(events) // 3
    for start in range(0, len(events), part):
        continued += take(slam, events[start : start + part])
        slam.save(path)
        slam = RatSlam.load(path)
    assert continued == steps and slam.config == whole.config
    assert same(everything(slam), everything(whole))


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Of the file of a run with images."""
    slam, path = RatSlam(views=TemplateSource(bottom=100)), tmp_path_factory.mktemp("s") / "s.npz"
    take(slam, drive("visual")[1])
    slam.save(path)
    return path.read_bytes()


@pytest.fixture
def saved(tmp_path: Path, content: bytes) -> Path:
    (tmp_path / "state.npz").write_bytes(content)
    return tmp_path / "state.npz"


def test_cutting_a_file_anywhere_is_one_error_that_names_it(saved: Path, content: bytes) -> None:
    for share in (0, 0.001, 0.1, 0.5, 0.9, 0.999):
        saved.write_bytes(content[: int(len(content) * share)])
        with pytest.raises(DataError, match=r"state\.npz"):
            RatSlam.load(saved)


def test_flipped_bytes_are_noticed(saved: Path, content: bytes) -> None:
    whole = everything(RatSlam.load(saved))
    for at in np.random.default_rng(0).integers(0, len(content) // 2, 20):
        damaged = bytearray(content)
        damaged[at] ^= 0xFF
        saved.write_bytes(damaged)
        try:
            slam = RatSlam.load(saved)
        except DataError as error:
            assert "state.npz" in str(error)
        else:  # the byte is in padding, which nobody reads
            assert same(everything(slam), whole)


def test_a_file_that_is_missing_or_no_archive_is_named(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("no archive at all\n")
    np.savez(tmp_path / "other.npz", a=np.arange(3))
    np.save(tmp_path / "one.npy", np.arange(3))
    for name in ("text.npz", "other.npz", "one.npy", "missing.npz", "."):
        with pytest.raises(DataError, match=str(tmp_path)):
            RatSlam.load(tmp_path / name)


@rows(
    "change",
    [
        lambda about, _: about.update(format="fusionslam.ratslam.0"),
        lambda about, _: about["config"].update(colour=1),
        lambda about, _: about["config"]["cells"].update(size=30),
        lambda about, _: about["config"].update(preset="openratslam"),
        lambda about, _: about.pop("memory"),
        lambda about, _: about["memory"].update(colour=1),
        lambda about, _: about["memory"]["node_views"].append(0),
        lambda _, arrays: arrays.pop("cells.cells"),
        lambda about, _: about.update(views="smell"),
        lambda about, _: about.update(views="view matcher"),
    ],
)
def test_files_of_something_else_are_refused(saved: Path, content: bytes, change: Any) -> None:
    saved.write_bytes(content)
    change_archive(saved, change)
    with pytest.raises(DataError, match=r"state\.npz"):
        RatSlam.load(saved)


class Stones:
    """A source of views of one's own."""

    kind = title = "stones"

    def __init__(self) -> None:
        self.seen: list[int] = []

    @property
    def known(self) -> int:
        return len(self.seen)

    def look(self, item: int, stamp_ns: int) -> Sighting:
        self.seen = list(dict.fromkeys([*self.seen, item]))
        return Sighting(stamp_ns, self.seen.index(item))

    def to_bytes(self) -> bytes:
        return json.dumps(self.seen).encode()

    def restore(self, content: bytes) -> None:
        self.seen = json.loads(content)


def test_a_source_of_ones_own_is_saved_and_given_again(tmp_path: Path) -> None:
    slam = RatSlam(views=Stones())
    take(slam, [Look(1, 70), Look(2, 90), Look(3, 70)])
    slam.save(tmp_path / "s.npz")
    for views in (None, TemplateSource()):
        with pytest.raises(DataError, match="stones"):
            RatSlam.load(tmp_path / "s.npz", views=views)
    found = RatSlam.load(tmp_path / "s.npz", views=Stones())
    assert found.step(Look(4, 90)).view_id == 1


class Full(io.FileIO):
    """A file on a disk that is full after some bytes."""

    room = 0

    def write(self, content: Any) -> int:
        if self.tell() + len(memoryview(content).cast("B")) > self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(content)


def test_a_full_disk_is_an_error_that_leaves_the_old_file_and_nothing_else(
    saved: Path, content: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    slam, real = RatSlam.load(saved), Path.open
    take(slam, [Look(100 * SECOND, images(9, 0))])
    before = everything(slam)

    def open_full(path: Path, mode: str = "r", *more: Any, **words: Any) -> Any:
        return Full(path, "w") if mode == "wb" else real(path, mode, *more, **words)

    for room in (0, 300, 30_000):
        with monkeypatch.context() as patch:
            patch.setattr(Path, "open", open_full)
            patch.setattr(Full, "room", room)
            with pytest.raises(DataError, match=os.strerror(errno.ENOSPC)):
                slam.save(saved)
        assert saved.read_bytes() == content
        assert [path.name for path in saved.parent.iterdir()] == ["state.npz"]
        assert same(everything(slam), before)
    slam.save(saved)
    assert same(everything(RatSlam.load(saved)), before)


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("kept")
    with pytest.raises(DataError, match="file"):
        RatSlam().save(tmp_path / "file" / "state.npz")


def test_a_device_is_never_replaced_by_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(DataError, match="pipe"):
        RatSlam().save(tmp_path / "pipe")
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"] and (tmp_path / "pipe").is_fifo()


def test_the_file_is_a_plain_archive_without_pickles(saved: Path) -> None:
    with zipfile.ZipFile(saved) as archive:
        assert archive.testzip() is None
    with np.load(saved, allow_pickle=False) as stored:
        assert all(stored[name].dtype != object for name in stored.files)


@pytest.fixture(scope="module")
def events() -> list[Event]:
    return circle_events(1.1)


@pytest.fixture(scope="module")
def whole(events: list[Event]) -> RatSlam:
    slam = RatSlam()
    take(slam, events)
    return slam


@rows("preset", PRESETS)
def test_two_runs_save_the_same_bytes(tmp_path: Path, preset: str) -> None:
    noise = OdometryConfig(speed_noise=0.02, turn_noise=0.02, seed=5)
    files = []
    for name in ("one.npz", "two.npz"):
        slam = RatSlam(preset=preset)
        take(slam, circle_events(0.3, noise))
        slam.save(tmp_path / name)
        files.append((tmp_path / name).read_bytes())
    assert files[0] == files[1]


@rows("delay_s, seed", [(0.0, 0), (0.04, 1), (0.49, 3)])
def test_events_that_arrive_late_give_the_same_map(
    events: list[Event], whole: RatSlam, delay_s: float, seed: int
) -> None:
    slam, order = RatSlam(), StampOrder(wait=0.5)
    delays = np.random.default_rng(seed).uniform(0, delay_s * 1e9, len(events))
    arrivals = np.array([event.stamp_ns for event in events]) + delays
    for k in np.argsort(arrivals, kind="stable"):
        take(slam, order.add(events[k]))
    take(slam, order.flush())
    assert order.too_late == 0
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


class WatchedLock:
    """A lock that tells when a thread has to wait for it."""

    def __init__(self) -> None:
        self._lock, self.awaited = threading.RLock(), threading.Event()

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            self.awaited.set()
            self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()


class SlowViews:
    """A view source that lets another thread act in the middle of a step."""

    kind = title = "slow"

    def __init__(self) -> None:
        self.meanwhile: Callable[[], object] | None = None
        self.lock, self.known = WatchedLock(), 0
        self.others: list[threading.Thread] = []

    def __deepcopy__(self, memo: object) -> "SlowViews":
        return self

    def look(self, item: Any, stamp_ns: int) -> Sighting:
        self.known = max(self.known, item + 1)
        if (work := self.meanwhile) is not None:
            self.meanwhile = None

            def run() -> None:
                work()
                self.lock.awaited.set()

            self.others.append(threading.Thread(target=run))
            self.others[0].start()
            # The other thread waits for this step, or has ended, and then did so wrongly.
            assert self.lock.awaited.wait(300)
        return Sighting(stamp_ns, item)

    def to_bytes(self) -> bytes:
        return bytes([self.known])

    def restore(self, content: bytes) -> None:
        self.known = content[0]


def step_meanwhile(work: Callable[[RatSlam], object]) -> RatSlam:
    """A map that another thread works with in the middle of its last step."""
    views = SlowViews()
    slam = RatSlam(views=views)
    slam._lock = views.lock
    for stamp_ns in range(0, 10**9, 10**8):
        slam.step(Motion(stamp_ns, 0.5, 0.1))
    views.meanwhile = partial(work, slam)
    slam.step(Look(10**9, 0))
    views.others[0].join()
    return slam


def test_a_map_is_saved_between_two_steps(tmp_path: Path) -> None:
    slam = step_meanwhile(lambda slam: slam.save(tmp_path / "state.npz"))
    saved = RatSlam.load(tmp_path / "state.npz", views=SlowViews())
    assert same(everything(saved), everything(slam))
    assert saved.seen_ns == slam.seen_ns == (9 * 10**8, 10**9)


def copy_memory(slam: RatSlam) -> Any:
    return pickle.loads(pickle.dumps(slam.__getstate__()["memory"]))


def test_a_map_is_copied_and_shown_between_two_steps() -> None:
    memories, maps = list[Any](), list[LiveMap]()
    slam = step_meanwhile(lambda slam: memories.append(copy_memory(slam)))
    assert memories == [slam.memory]
    slam = step_meanwhile(lambda slam: maps.append(LiveMap.of(slam, "drive", "wheels")))
    (shown,) = maps
    assert len(shown.nodes) == len(shown.node_views) == len(slam.map)


@rows("preset", PRESETS)
def test_every_file_saved_beside_a_stepping_thread_can_be_loaded(
    tmp_path: Path, events: list[Event], preset: str
) -> None:
    slam, done = RatSlam(preset=preset), threading.Event()

    def step() -> None:
        take(slam, events)
        done.set()

    def save() -> None:
        saves = 0
        while not done.is_set() or saves < 3:
            slam.save(tmp_path / "state.npz")
            saved = RatSlam.load(tmp_path / "state.npz")
            assert len(saved.map) == len(saved.memory.node_views)
            saves += 1

    run_together(step, save)
    assert len(slam.map) > 5
