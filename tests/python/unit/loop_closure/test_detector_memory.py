# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""LoopDetector: forgets what it may, keeps what several threads add."""

import pickle
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from detector_places import DRIVE, wander
from fusionslam import Cloud, Loop, LoopDetector


def test_a_bounded_detector_keeps_the_first_visit_to_every_place() -> None:
    rows = wander(places=60, frames=3000)
    detector = LoopDetector(threshold=0.5, window=2, max_frames=100, length=8)
    for row in rows:
        detector.add_descriptor(row)
        assert len(detector.frames) < 100
    assert len(detector) == 3000
    assert set(range(60)) <= set(detector.frames.tolist())
    for place in range(50):  # not seen for 2900 frames
        loop = detector.add_descriptor(rows[place])
        assert loop == Loop(3000 + place, place, 0.0)


def test_the_newest_frames_are_never_forgotten() -> None:
    detector = LoopDetector(threshold=9.0, window=7, max_frames=20, length=8)
    for count, row in enumerate(wander(places=20, frames=300), start=1):
        loop = detector.add_descriptor(row)
        assert loop is None or loop.query - loop.match > 7
        newest = detector.frames[-min(count, 7) :]
        assert newest.tolist() == list(range(count - len(newest), count))


def test_below_the_bound_nothing_is_forgotten_and_nothing_changes() -> None:
    bounded = LoopDetector(threshold=0.5, window=3, max_frames=301, length=8)
    free = LoopDetector(threshold=0.5, window=3, max_frames=0, length=8)
    for row in wander(places=60, frames=300):
        assert bounded.add_descriptor(row) == free.add_descriptor(row)
    assert len(bounded.frames) == 300


def test_a_bounded_detector_is_saved_and_pickled_with_what_it_has_left(tmp_path: Path) -> None:
    rows = wander(places=30, frames=200)
    detector = LoopDetector(threshold=0.5, window=2, max_frames=50, length=8)
    for row in rows[:150]:
        detector.add_descriptor(row)
    detector.save(tmp_path)
    for copy in (LoopDetector.load(tmp_path), pickle.loads(pickle.dumps(detector))):
        assert len(copy) == 150 and np.array_equal(copy.frames, detector.frames)
        original = LoopDetector.load(tmp_path)
        for row in rows[150:]:
            assert copy.add_descriptor(row) == original.add_descriptor(row)
        assert np.array_equal(copy.frames, original.frames)


@pytest.mark.parametrize("descriptor", ["m2dp", "shot"])
def test_frames_that_threads_add_first_at_once_are_all_kept(descriptor: str) -> None:
    for _ in range(5):
        detector = LoopDetector(descriptor, window=0)
        start = threading.Barrier(3)

        def add(cloud: Cloud, detector: Any = detector, start: Any = start) -> None:
            start.wait()
            detector.add(cloud)

        threads = [threading.Thread(target=add, args=(cloud,)) for cloud in DRIVE[:3]]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(detector) == 3 and detector.frames.tolist() == [0, 1, 2]
        for cloud in DRIVE[:3]:  # all three were stored with the same radius
            detector.add(cloud)
            assert detector.nearest is not None
            assert detector.nearest.distance < 1e-6


def test_no_number_is_given_twice_or_lost_while_threads_add_and_frames_are_forgotten() -> None:
    detector = LoopDetector(threshold=9.0, window=0, max_frames=40, length=8)
    rows, queries = wander(places=30, frames=400), []

    def add_all(part: Any) -> None:
        for row in part:
            if loop := detector.add_descriptor(row):
                queries.append(loop.query)

    threads = [threading.Thread(target=add_all, args=(rows[k::4],)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(detector) == 400 and sorted(queries) == list(range(1, 400))
