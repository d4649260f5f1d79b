# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Poses searched in images from above."""

from itertools import combinations, product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from clouds import scan_blocks
from fusionslam.base.arrays import Floats, Points
from fusionslam.registration import (
    PreparedCloud,
    RegistrationConfig,
    compare_images,
    search_poses,
)
from rows import rows
from streets import at


def posts(places: Floats) -> Points:
    """Posts 3 m high on a floor 1.7 m below the sensor."""
    heights = np.arange(0, 3, 0.4)
    upright = [(x, y, z - 1.7) for x, y in places for z in heights]
    floor = [(x, y, -1.7) for x in range(-30, 31, 2) for y in range(-30, 31, 2)]
    return np.array(upright + floor, np.float32)


@rows("yaw_deg, there", product([0.0, 90.0, 178.0, -67.0], [(2.0, 1.0), (12.0, -9.0)]))
def test_a_pose_is_found_whatever_the_turn(there: tuple[float, float], yaw_deg: float) -> None:
    here, other = at(3, -2, 20), at(*there, yaw_deg)
    (found,) = search_poses(
        PreparedCloud(scan_blocks(other, 1)), PreparedCloud(scan_blocks(here, 2))
    )
    off = np.linalg.inv(np.linalg.inv(here) @ other) @ found.pose
    assert np.linalg.norm(off[:2, 3]) < 2.5  # cells are 2 m
    assert np.degrees(Rotation.from_matrix(off[:3, :3]).magnitude()) < 6
    assert 0.4 < found.correlation < 1


def test_posts_shifted_by_whole_cells_are_found_to_the_cell() -> None:
    places = np.array([[9, 5], [-13, 7], [5, -11], [-7, -15], [19, 17], [1, 21]], float)
    cloud, moved = PreparedCloud(posts(places)), PreparedCloud(posts(places + np.array([6, -4])))
    (found,) = search_poses(cloud, moved)
    np.testing.assert_allclose(found.pose[:2, 3], [6, -4], atol=1e-9)
    assert found.correlation == pytest.approx(1, abs=1e-5)


def test_a_cloud_equals_itself_and_other_turns_are_less_alike() -> None:
    cloud = PreparedCloud(scan_blocks(at(3, -2, 20), 1))
    poses = search_poses(cloud, cloud, 3)
    np.testing.assert_allclose(poses[0].pose, np.eye(4), atol=1e-9)
    assert poses[0].correlation == pytest.approx(1, abs=1e-5)
    assert 1 > poses[1].correlation >= poses[2].correlation
    turns = [np.degrees(np.arctan2(*each.pose[[1, 0], 0])) for each in poses]
    for one, other in combinations(turns, 2):
        assert abs((one - other + 180) % 360 - 180) > 20


@rows("there", [(3.0, -2.0), (4.0, -1.0), (12.0, -9.0)])
def test_a_coarse_comparison_has_the_scale_of_the_fine_one(there: tuple[float, float]) -> None:
    cloud = PreparedCloud(scan_blocks(at(3, -2, 20), 1))
    other = PreparedCloud(scan_blocks(at(*there, 20), 1))
    fine = search_poses(cloud, other)[0].correlation
    assert fine / 2 < compare_images(cloud, other.search_image) < fine + 0.1


def test_nothing_above_the_ground_gives_no_pose() -> None:
    empty = PreparedCloud(np.empty((0, 3), np.float32))
    some = PreparedCloud(scan_blocks(at(3, -2, 20), 1))
    assert search_poses(empty, some) == [] and search_poses(some, empty) == []


def test_heights_are_those_of_the_ground() -> None:
    cloud = scan_blocks(at(3, -2, 20), 1)
    raised = cloud + np.float32([0, 0, 1])
    (found,) = search_poses(PreparedCloud(cloud), PreparedCloud(raised))
    assert found.pose[2, 3] == pytest.approx(1, abs=0.02)


def test_smaller_cells_are_for_smaller_places() -> None:
    scale = np.float32(0.2)
    here, other = at(3, -2, 20), at(6, 1, 100)
    rooms = RegistrationConfig(voxel=0.1, search_cell=0.4, ground_height=0.1)
    (found,) = search_poses(
        PreparedCloud(scan_blocks(other, 1) * scale, rooms),
        PreparedCloud(scan_blocks(here, 2) * scale, rooms),
    )
    truth = np.linalg.inv(here) @ other
    np.testing.assert_allclose(found.pose[:2, 3], truth[:2, 3] * scale, atol=0.5)
