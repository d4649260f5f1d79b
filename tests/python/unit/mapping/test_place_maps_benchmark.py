# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of maps measures what it says, on drives whose answers are known."""

import numpy as np
import pytest

from benchmarks.accuracy import place_maps
from benchmarks.accuracy.mapped_drives import Fix
from benchmarks.accuracy.place_maps import DRIFT, SCALE, add_drift, fixes_table
from benchmarks.accuracy.pose_graphs import ate, fit_motion
from fusionslam.geometry.se3 import exp, inverse
from fusionslam.mapping import Edge
from fusionslam.storage.arrays import Floats


@pytest.fixture
def drive() -> Floats:
    """A circle of 40 m radius, driven three times."""
    angle = np.linspace(0, 6 * np.pi, 600)
    poses = np.tile(np.eye(4), (600, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = 40 * np.cos(angle), 40 * np.sin(angle)
    return poses


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
        [inverse(poses[:-1]) @ poses[1:] for poses in (add_drift(drive, k) for k in range(30))]
    )
    metres = np.linalg.norm(true[0, :3, 3])
    errors = steps[:, :3, 3] - SCALE * np.tile(true[:, :3, 3], (30, 1))
    np.testing.assert_allclose(errors.std(axis=0), DRIFT[0] * np.sqrt(metres), rtol=0.03)
    tilt = steps[:, 2, 1] - np.tile(true[:, 2, 1], 30)
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


def test_shares_are_of_frames_near_a_keyframe(
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
