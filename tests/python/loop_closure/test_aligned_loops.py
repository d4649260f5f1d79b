# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Loops by descriptors whose clouds are aligned: true poses in made rooms, files, bad input."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fusionslam import DataError, LoopDetector
from fusionslam.loop_closure.aligned import AlignedLoop, AlignedLoopDetector
from fusionslam.sensors.frame import Cloud
from stored import write_as_former_detector
from worlds import AHEAD, Pose, room, scan, seen_from

THERE: Pose = (0.2, -0.3, 0.5)
BACK: Pose = (0.4, -0.2, 0.6)


def scan_from(pose: Pose, number: int = 0) -> Cloud:
    return scan(room(number), pose, AHEAD, seed=number)


DRIVE = [
    scan_from(THERE),
    scan_from((0.0, 0.0, 3.0), 1),
    scan_from((0.5, 0.5, 1.0), 2),
    scan_from(BACK),
]


def detector() -> AlignedLoopDetector:
    return AlignedLoopDetector(LoopDetector("cm2dp", window=1, threshold=2.0))


def add_all(loops: AlignedLoopDetector, clouds: list[Cloud]) -> list[AlignedLoop | None]:
    first = len(loops)
    return [loops.add(cloud, 10 * (first + k)) for k, cloud in enumerate(clouds)]


def test_the_pose_is_that_of_the_newer_cloud_in_the_frame_of_the_older() -> None:
    found = add_all(detector(), DRIVE)[-1]
    assert found is not None and found.pose is not None and found.probability is not None
    assert (found.loop.query, found.loop.match, found.match_stamp_ns) == (3, 0, 0)
    assert found.probability > 0.9
    np.testing.assert_allclose(found.pose, seen_from(THERE, BACK), atol=0.03)


@pytest.mark.parametrize("pose", [(1.2, -0.3, 0.5), (0.2, -0.3, 1.2)])
def test_clouds_farther_apart_than_allowed_have_a_pose_of_probability_0(pose: Pose) -> None:
    found = add_all(detector(), [*DRIVE[:3], scan_from(pose)])[-1]
    assert found is not None and (found.loop.match, found.probability) == (0, 0.0)
    assert found.pose is not None
    np.testing.assert_allclose(found.pose, seen_from(THERE, pose), atol=0.03)


def test_clouds_with_too_little_to_align_have_no_pose() -> None:
    points = np.array([[2, 0, 0], [3, 1, 0.5], [2, -1, 1], [4, 0, 0.2]], np.float32)
    few = Cloud(points, np.full((4, 3), 90, np.uint8))
    found = add_all(detector(), [few, *DRIVE[1:3], few])[-1]
    assert found is not None and found.loop.match == 0
    assert found.pose is None and found.probability is None


def test_a_stored_detector_goes_on_as_if_it_had_never_stopped(tmp_path: Path) -> None:
    whole, first = detector(), detector()
    wanted = add_all(whole, DRIVE)
    add_all(first, DRIVE[:2])
    first.save(tmp_path)
    assert add_all(AlignedLoopDetector.load(tmp_path), DRIVE[2:]) == wanted[2:]


def test_loops_of_an_earlier_version_go_on_and_are_stored_in_one_file(tmp_path: Path) -> None:
    wanted = add_all(detector(), DRIVE)
    first = detector()
    add_all(first, DRIVE[:3])
    first.save(tmp_path)
    write_as_former_detector(tmp_path)
    assert (tmp_path / "scenes.npz").exists()
    again = AlignedLoopDetector.load(tmp_path)
    again.save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["detector.npz"]
    assert add_all(again, DRIVE[3:]) == wanted[3:]


def test_a_refused_cloud_leaves_no_trace() -> None:
    loops = detector()
    add_all(loops, DRIVE[:3])
    for bad in (replace(DRIVE[3], colors=None), Cloud(np.zeros((0, 3), np.float32), None)):
        with pytest.raises(DataError):
            loops.add(bad, 30)
    assert len(loops) == 3 and add_all(loops, DRIVE[3:]) == add_all(detector(), DRIVE)[3:]


def test_a_damaged_file_is_refused_whatever_is_wrong_with_it(tmp_path: Path) -> None:
    loops = detector()
    add_all(loops, DRIVE[:2])
    loops.save(tmp_path)
    path = tmp_path / "detector.npz"
    whole, random = path.read_bytes(), np.random.default_rng(5)
    directory = whole.index(b"PK\x01\x02")  # whose flags zipfile believes
    refused = 0
    for _ in range(300):
        damaged = bytearray(whole)
        damaged[int(random.integers(directory, len(whole)))] ^= 1 << int(random.integers(8))
        path.write_bytes(damaged)
        try:
            AlignedLoopDetector.load(tmp_path)
        except DataError as error:
            refused += str(path) in str(error)
    assert refused > 100
    path.unlink()
    with pytest.raises(DataError, match=r"detector\.npz"):
        AlignedLoopDetector.load(tmp_path)


def test_a_file_of_another_version_is_named(tmp_path: Path) -> None:
    loops = detector()
    add_all(loops, DRIVE[:2])
    loops.save(tmp_path)
    path = tmp_path / "detector.npz"
    with np.load(path) as stored:
        arrays = {**stored, "about": np.array('{"format": "fusionslam.loop_detector.0"}')}
    np.savez(path, **arrays)
    with pytest.raises(DataError, match=r"detector\.npz.*loop_detector\.0"):
        AlignedLoopDetector.load(tmp_path)
    path.write_text("something else")
    with pytest.raises(DataError, match=r"detector\.npz"):
        AlignedLoopDetector.load(tmp_path)


def test_scenes_are_forgotten_with_their_frames_and_loops_still_aligned(tmp_path: Path) -> None:
    limited = LoopDetector("cm2dp", window=1, threshold=2.0, max_frames=6)
    loops = AlignedLoopDetector(limited)
    add_all(loops, [*DRIVE[:3], *DRIVE[:3], *DRIVE[:3]])
    assert len(loops) == 9 and len(limited.frames) < 6
    loops.save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["detector.npz"]
    for each in (loops, AlignedLoopDetector.load(tmp_path)):
        found = each.add(DRIVE[3], 90)
        assert found is not None and found.pose is not None
        assert (found.loop.match, found.match_stamp_ns) == (0, 0)
        np.testing.assert_allclose(found.pose, seen_from(THERE, BACK), atol=0.03)
