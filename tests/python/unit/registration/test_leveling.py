# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Which way is up: by the ground, by odometry, by how a sensor is mounted, in this order."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clouds import scan_blocks
from fusionslam.base.arrays import Matrix, Points
from fusionslam.loop_closure.local_maps import RecentFrames
from fusionslam.loop_closure.observation import Observation
from fusionslam.registration.leveling import find_ground, find_level
from rows import rows
from streets import at

SCAN = scan_blocks(at(0, 0, 0), 1)


def turned_by(angles: tuple[float, float, float]) -> Matrix:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("zyx", angles, degrees=True).as_matrix()
    return pose


def tilted(angles: tuple[float, float, float]) -> tuple[Points, Matrix]:
    """The scan of a sensor that is turned about z, y and x, and the pose that odometry gives."""
    pose = turned_by(angles)
    return (SCAN @ pose[:3, :3]).astype(np.float32), pose


ANGLES = (40.0, 25.0, -10.0)


def off_level(odometry: Matrix) -> float:
    """Degrees between up and the z axis of the scan, tilted by ANGLES, once it is levelled."""
    points, pose = tilted(ANGLES)
    level = find_level(points, odometry)
    assert level.level_from_cloud is not None
    return float(np.degrees(np.arccos((level.level_from_cloud @ pose[2, :3])[2])))


@rows("angles", [(0, 5, 0), (30, 15, 4), (200, 0, 30), (90, -30, 30), (10, 45, 0)])
def test_the_ground_tells_what_is_up(angles: tuple[float, float, float]) -> None:
    points, pose = tilted(angles)
    level = find_level(points)
    assert level.source == "ground" and level.level_from_cloud is not None
    up = level.level_from_cloud @ pose[2, :3]
    assert np.degrees(np.arccos(up[2])) < 1
    assert level.tilt == pytest.approx(np.degrees(np.arccos(pose[2, 2])), abs=1)
    np.testing.assert_allclose(
        level.level_from_cloud @ level.level_from_cloud.T, np.eye(3), atol=1e-12
    )


def test_the_ground_is_believed_before_odometry_that_drifts_or_begins_tilted() -> None:
    _, pose = tilted(ANGLES)
    drifted = pose.copy()
    drifted[:3, :3] = Rotation.from_euler("x", 12, degrees=True).as_matrix() @ pose[:3, :3]
    for odometry in (pose, drifted, np.eye(4)):  # visual odometry begins with the identity
        assert off_level(odometry) < 1


def test_little_ground_counts_where_the_sensor_is_mounted_level() -> None:
    """Above a car's roof, say, odometry has drifted by 10 degrees."""
    rng = np.random.default_rng(0)
    ground = rng.uniform([-20, -20, -2.02], [20, 20, -1.98], (600, 3))
    things = rng.uniform([-20, -20, -1.9], [20, 20, 8], (2400, 3))
    points = np.concatenate([ground, things]).astype(np.float32)
    assert find_ground(points) is None
    drifted = turned_by((0, 10, 0))
    assert find_level(points, drifted).level_from_cloud is None
    tilt = turned_by((0, 20, 0))  # of the sensor: then it counts near what odometry tells
    tilted_points = (points @ tilt[:3, :3]).astype(np.float32)
    for drift, source in ((5, "ground"), (15, "odometry")):
        assert find_level(tilted_points, turned_by((0, 0, drift)) @ tilt).source == source


def bushes(pose: Matrix) -> Points:
    """What shows no ground, seen by a sensor that is turned."""
    points = np.random.default_rng(0).normal(0, 5, (3000, 3))
    return (points @ pose[:3, :3]).astype(np.float32)


def test_odometry_that_drifts_in_tilt_is_righted_by_the_grounds_seen_last() -> None:
    """Of a sensor that is pitched down and shows the ground in every other frame."""
    recent = RecentFrames()
    for number in range(20):
        points, pose = tilted((10.0 * number, 15, 0))
        drifted = turned_by((0, 0, 1.0 * number)) @ pose
        shown = bushes(pose) if number % 2 else points
        level = find_level(shown, drifted, up=recent.up)
        assert level.source == ("odometry" if number % 2 else "ground")
        assert np.degrees(np.arccos(level.up @ pose[2, :3])) < 6  # they are 1 to 9 frames old
        Observation({}, None, odometry=drifted, level=level).add_to(recent, number)
    recent.clear()
    assert recent.up is None


def test_little_ground_counts_where_the_grounds_seen_last_were_alike() -> None:
    rng = np.random.default_rng(0)
    ground = rng.uniform([-20, -20, -2.02], [20, 20, -1.98], (600, 3))
    things = rng.uniform([-20, -20, -1.9], [20, 20, 8], (2400, 3))
    pose, drift = turned_by((0, 20, 0)), turned_by((0, 0, 15))
    points = (np.concatenate([ground, things]) @ pose[:3, :3]).astype(np.float32)
    assert find_level(points, drift @ pose).source == "odometry"
    level = find_level(points, drift @ pose, up=drift[:3, 2])
    assert level.source == "ground"
    assert np.degrees(np.arccos(level.up @ pose[2, :3])) < 1


@rows("angle", [20, 90, 179.99, 180])
def test_without_a_ground_odometry_tells_and_else_the_mounting(angle: float) -> None:
    """Even of sensors on their side or upside down."""
    pose = turned_by((0, 0, angle))
    for level, source in (
        (find_level(bushes(pose), pose, np.eye(4)), "odometry"),
        (find_level(bushes(pose), mounting=pose), "mounting"),
    ):
        assert level.level_from_cloud is not None and level.source == source
        np.testing.assert_allclose(level.level_from_cloud @ pose[2, :3], [0, 0, 1], atol=1e-6)
        assert np.linalg.det(level.level_from_cloud) == pytest.approx(1)


def test_the_ground_is_found_on_the_side_that_odometry_tells() -> None:
    points, pose = tilted((0, 120, 0))
    assert find_ground(points) is None or find_level(points, pose).source == "ground"
    assert find_level(points, pose).tilt == pytest.approx(120, abs=1)


def test_level_clouds_stay_as_they_are() -> None:
    for angles in ((0, 0, 0), (77, 2, -2)):
        points, pose = tilted(angles)
        for odometry in (None, pose):
            assert find_level(points, odometry).level_from_cloud is None


def test_what_shows_no_ground_is_left_to_odometry_or_as_it_is() -> None:
    rng = np.random.default_rng(0)
    wall = rng.uniform([4, -5, -1], [4.02, 5, 3], (3000, 3)).astype(np.float32)
    cloud = rng.normal(0, 5, (3000, 3)).astype(np.float32)  # as of leaves
    for points in (wall, cloud, cloud[:10], cloud[:0]):
        assert find_ground(points) is None
        assert find_level(points).source == "cloud"
        assert find_level(points).level_from_cloud is None


def test_a_ceiling_is_no_ground() -> None:
    rng = np.random.default_rng(0)
    ceiling = rng.uniform([-5, -5, 2], [5, 5, 2.02], (3000, 3)).astype(np.float32)
    assert find_ground(ceiling) is None
