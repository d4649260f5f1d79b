# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Frames of drives in the joint map of their site."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fleet_service import map_pose_at, write_joint_map
from fusionslam.fleet.joint_map import JoinedDrive, JointMap
from fusionslam.storage.arrays import Floats
from rows import rows


def turned(degrees: float, x: float) -> Floats:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    pose[0, 3] = x
    return pose


DRIVE = JoinedDrive(
    frames=np.array([10, 20, 24, 30, 40]),
    poses=np.array(
        [turned(0, 0), turned(90, 4), turned(0, 5), turned(0, 9), np.full((4, 4), np.nan)]
    ),
    stretches=np.array([0, 0, 2, 2, 4]),
)


@rows(
    "frame, expected",
    [
        (10, turned(0, 0)),
        (15, turned(45, 2)),
        (20, turned(90, 4)),
        (22, turned(90, 4)),  # odometry was lost after frame 20
        (27, turned(0, 7)),
        (35, turned(0, 9)),  # the next keyframe is in another part
        (3, turned(0, 0)),
        (40, None),
        (50, None),
    ],
)
def test_a_frame_lies_between_the_keyframes_that_odometry_connects(
    frame: int, expected: Floats | None
) -> None:
    found = DRIVE.pose_at(frame)
    if expected is None:
        assert found is None
    else:
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_drives_of_the_first_part_of_a_map_are_read(tmp_path: Path) -> None:
    pytest.importorskip("small_gicp", reason="maps are an extra")
    drives = {"monday": {0: 0, 2: 0, 4: 5}, "tuesday": {1: 0}, "elsewhere": {0: 9}}
    joint = JointMap.read(write_joint_map(tmp_path, "yard", drives))
    assert [*joint.drives] == ["monday", "tuesday"]
    assert joint.drives["monday"].frames.tolist() == [0, 2, 4]
    np.testing.assert_allclose(joint.pose_at("monday", 2), map_pose_at(2))
    assert joint.pose_at("monday", 4) is None and joint.pose_at("elsewhere", 0) is None
