# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmarks of maps in towns and rooms, merged maps and peers' loops measure what they say."""

import numpy as np
import pytest

from benchmarks.accuracy import map_merges, place_maps
from benchmarks.accuracy.map_peers import Drive, solve
from benchmarks.accuracy.mapped_drives import Fix, MappedDrive, Shares
from benchmarks.accuracy.place_maps import DRIFT, SCALE, add_drift, fixes_table
from benchmarks.accuracy.pose_graphs import ate, fit_motion
from benchmarks.accuracy.rooms import turn_back
from fusionslam import Cloud
from fusionslam.base.arrays import Floats
from fusionslam.evaluation import VerifiedRun
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.mapping import Edge
from fusionslam.mapping.map_merging import Merge
from fusionslam.registration import Refusal


def test_a_way_is_driven_back_at_the_same_speeds_looking_ahead() -> None:
    way = Trajectory(
        np.array([0.0, 1, 4]), np.array([0.0, 1, 2]), np.zeros(3), np.array([0.0, 0, 0.5])
    )
    back = turn_back(way)
    np.testing.assert_allclose(back.seconds, [0, 3, 4])
    np.testing.assert_allclose(back.x, [2, 1, 0])
    np.testing.assert_allclose(back.yaw - np.pi, [0.5, 0, 0])


def test_a_fix_far_from_the_truth_is_found_but_not_good() -> None:
    fixes = [
        Fix(1.0, 0.1, 0.5, 0.01, 0.2, None),
        Fix(1.0, 2.5, 0.5, 2.4, 0.2, None),
        Fix(1.0, None, None, None, 0.2, "alone"),
        Fix(6.0, None, None, None, 0.2, "no-candidates"),
    ]
    shares = Shares(fixes)
    assert (shares.near, shares.found, shares.good) == (3, pytest.approx(2 / 3), 0.5)
    assert shares.worst.tolist() == [2.5, 0.5, 2.4]
    assert Shares(fixes, 6.5).near == 4


@pytest.fixture
def drive() -> Floats:
    """A circle of 40 m radius, driven twice, 100 frames a lap."""
    angle = np.linspace(0, 4 * np.pi, 201)
    poses = exp(np.stack([*[np.zeros(201)] * 5, angle], axis=1))
    poses[:, 0, 3], poses[:, 1, 3] = 40 * np.cos(angle), 40 * np.sin(angle)
    return poses


def made_drive(poses: Floats, true: Floats, session: str) -> MappedDrive:
    mapped = MappedDrive.__new__(MappedDrive)
    mapped.poses, mapped.true_keyframes, mapped.session = poses, true, session
    return mapped


def test_a_merged_map_is_judged_by_two_drives(
    drive: Floats, monkeypatch: pytest.MonkeyPatch
) -> None:
    bent = drive.copy()
    bent[::2, 2, 3] += 0.2
    first, second = (made_drive(bent, drive, name) for name in ("first", "second"))
    edge = Edge(0, "merge", 0, 0, np.eye(4), np.eye(6), "believed")
    refused = Merge((), (), (edge,), Refusal("few-merges", 1, "too few"))
    moved = drive.copy()
    moved[:, 0, 3] += 5
    # The second drive lies 5 m off the first one on the merged map.
    joints = iter(
        [
            map_merges.Joint(
                Merge(("second",), (edge,) * 3, ()), np.concatenate([drive, moved]), 1
            ),
            map_merges.Joint(refused, None, 1),
        ]
    )
    monkeypatch.setattr(map_merges, "join", lambda one, other: next(joints))
    cells = map_merges.row("circle", first, second, second)
    assert cells[1:3] == ["0.100", "0.100"]
    assert float(cells[3]) == pytest.approx(2.5, rel=0.01)
    assert cells[5:7] == ["3", "0"]
    assert cells[-2:] == ["1", "no"]


def test_loops_of_peers_go_into_the_graph_and_false_ones_are_counted(drive: Floats) -> None:
    count = len(drive)
    steps = inverse(drive[:-1]) @ drive[1:] @ exp(np.array([0.02, 0, 0, 0, 0, 0.001]))
    odometry = [drive[0]]
    for step in steps:
        odometry.append(odometry[-1] @ step)
    rows = np.arange(count)
    match = np.maximum(rows - 100, -1)
    accepted = (match >= 0) & (rows % 2 == 0)
    poses = np.full((count, 4, 4), np.nan)
    poses[100:] = inverse(drive[:-100]) @ drive[100:]
    run = VerifiedRun(
        source="cloud",
        descriptors=("peer",),
        dataset="circle",
        frames=rows,
        numbers=rows,
        stamps_ns=rows,
        poses=drive,
        body_from_cloud=np.tile(np.eye(4), (count, 1, 1)),
        points=rows,
        match=match,
        match_from_query=poses,
        covariance=np.full((count, 6, 6), np.nan),
        overlap=np.full(count, np.nan),
        probability=np.where(match >= 0, 0.9, np.nan),
        distance=np.full(count, np.inf),
        accepted=accepted,
        candidates=match[:, None],
        seconds={"match": np.full(count, 0.5)},
    )
    given = Drive([Cloud(np.zeros((1, 3), np.float32))] * count, drive, np.array(odometry))
    mapped = solve("peer", given, run)
    assert (mapped.loops, mapped.false) == (51, 0)
    assert mapped.seconds == pytest.approx(0.5 * count)
    shifted = np.array(poses)
    shifted[accepted] = shifted[accepted] @ exp(np.array([1.5, 0, 0, 0, 0, 0]))
    run.match_from_query[:] = shifted
    # All agree, so that nothing contradicts them.
    assert solve("peer", given, run).false > 40
    assert solve("peer", given, run).ate > mapped.ate


def test_a_moved_drive_is_aligned_by_the_motion_that_moved_it(drive: Floats) -> None:
    moved = exp(np.array([3.0, -2, 1, 0.1, -0.2, 2])) @ drive
    np.testing.assert_allclose(fit_motion(moved, drive) @ moved, drive, atol=1e-9)
    assert ate(moved, drive) < 1e-9
    away = drive.copy()
    away[::2, 2, 3] += 0.2  # half the poses 0.1 m above the mean, half below it
    assert ate(away, drive) == pytest.approx(0.1, rel=1e-3)


def test_odometry_drifts_as_stated(drive: Floats) -> None:
    true = inverse(drive[:-1]) @ drive[1:]
    steps = np.concatenate(
        [inverse(poses[:-1]) @ poses[1:] for poses in (add_drift(drive, k) for k in range(8))]
    )
    metres = np.linalg.norm(true[0, :3, 3])
    errors = steps[:, :3, 3] - SCALE * np.tile(true[:, :3, 3], (8, 1))
    np.testing.assert_allclose(errors.std(axis=0), DRIFT[0] * np.sqrt(metres), rtol=0.03)
    tilt = steps[:, 2, 1] - np.tile(true[:, 2, 1], 8)
    assert tilt.std() == pytest.approx(DRIFT[1] * np.sqrt(metres), rel=0.03)


@pytest.fixture
def town(drive: Floats) -> place_maps.Town:
    """A town that was mapped without errors."""
    town = place_maps.Town.__new__(place_maps.Town)
    town.seed, town.true_keyframes = 1, drive
    return town


def test_a_loop_is_false_beyond_a_metre_or_five_degrees(town: place_maps.Town) -> None:
    truly = inverse(town.true_keyframes[0]) @ town.true_keyframes[200]

    def edge(*motion: float) -> Edge:
        return Edge(0, "loop", 0, 200, truly @ exp(np.array(motion)), np.eye(6), "believed")

    assert not town.is_false(edge(0.9, 0, 0, 0, 0, np.radians(4)))
    assert town.is_false(edge(0, 0, 1.1, 0, 0, 0))
    assert town.is_false(edge(0, 0, 0, np.radians(6), 0, 0))


def test_shares_are_of_frames_nearby(
    town: place_maps.Town, monkeypatch: pytest.MonkeyPatch
) -> None:
    fixes = [
        Fix(1.0, 0.1, 0.5, 0.01, 0.2, None),
        Fix(2.0, 0.6, 0.5, 0.02, 0.2, None),
        Fix(4.0, None, None, None, 0.3, "alone"),
        Fix(4.9, 0.2, 2.5, 0.03, 0.2, None),
        Fix(9.0, None, None, None, 0.3, "alone"),
    ]
    monkeypatch.setattr(place_maps.Town, "localize_all", lambda self, seed: fixes)
    row = fixes_table([town]).splitlines()[2].strip("| ").split(" | ")
    assert row[1:7] == ["4", "0.750", "0.333", "0.600", "2.500", "0.030"]
