# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Which way is up: by odometry, by how a sensor is mounted, by the ground, in this order."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clouds import scan_blocks
from fusionslam.base.arrays import Matrix, Points
from fusionslam.registration.leveling import find_ground, find_level
from rows import rows
from streets import at

SCAN = scan_blocks(at(0, 0, 0), 1)


def tilted(angles: tuple[float, float, float]) -> tuple[Points, Matrix]:
    """The scan of a sensor that is turned about z, y and x, and the pose that odometry gives."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("zyx", angles, degrees=True).as_matrix()
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


def test_odometry_is_believed_before_the_ground_unless_its_z_axis_is_not_up() -> None:
    points, pose = tilted(ANGLES)
    nearly = pose.copy()
    nearly[:3, :3] = Rotation.from_euler("x", 2, degrees=True).as_matrix() @ pose[:3, :3]
    level = find_level(points, nearly)
    assert level.source == "odometry"
    assert off_level(nearly) == pytest.approx(2, abs=0.01)
    # Visual odometry begins with the identity, whatever the camera's tilt.
    assert find_level(points, np.eye(4)).source == "ground"
    assert off_level(np.eye(4)) < 1


def test_a_mounting_tells_where_odometry_does_not() -> None:
    points, pose = tilted((0, 120, 0))  # no ground is looked for on this side
    assert find_level(points, mounting=pose).source == "mounting"
    upright = (points @ find_level(points, mounting=pose).level_from_cloud.T).astype(np.float32)
    assert find_ground(upright) is not None
    assert find_level(points, odometry=pose, mounting=np.eye(4)).source == "odometry"


@rows("angle", [90, 179.99, 180])
def test_odometry_levels_sensors_on_their_side_and_upside_down(angle: float) -> None:
    points, pose = tilted((0, 0, angle))
    level = find_level(points, pose)
    assert level.level_from_cloud is not None and level.source == "odometry"
    np.testing.assert_allclose(level.level_from_cloud @ pose[2, :3], [0, 0, 1], atol=1e-6)
    assert np.linalg.det(level.level_from_cloud) == pytest.approx(1)


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
