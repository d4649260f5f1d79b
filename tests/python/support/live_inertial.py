# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a live mapper with odometry of its own publishes of a bag with scans and IMU alone."""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np

import bags
from fusionslam.datasets.bags import open_bag
from fusionslam.datasets.bags.messages import value_of
from fusionslam.datasets.pose_files import read_poses_tum
from fusionslam.sensors.messages import FrameTransforms, Imu, Odometry, Scan
from inertial_house import inertial_house

VALUES = {
    "odometry": "inertial",
    "fusion/source": "cloud",
    "descriptor": "m2dp",
    "map/file": "site.fsmap",
}
MAPPER = tuple(f"_{key}:={value}" for key, value in VALUES.items())
"""Arguments of the node in ROS 1."""
MAPPER_2 = tuple(f"_{key.replace('/', '.')}:={value}" for key, value in VALUES.items())
"""In ROS 2."""


def write_sensors(path: Path) -> Path:
    """A bag of the house with scans, IMU and static transforms alone."""

    def is_kept(message: Any) -> bool:
        if isinstance(message, FrameTransforms):
            return all(each.static for each in message.transforms)
        return isinstance(message, Scan | Imu)

    with open_bag(inertial_house()) as bag:
        return bags.write_bag(path, [event for event in bag.events() if is_kept(event.message)])


def assert_same_odometry(messages: list[Any], command: list[str], bag: Path) -> None:
    """Odometry that was published is that of the command line, to the digits of its file.

    Args:
        messages: nav_msgs/Odometry.
        command: the command line where the node runs: other numpy rounds otherwise.
        bag: what was played.
    """
    path = bag.with_suffix(".txt")
    subprocess.run(
        [*command, "odometry", bag, "-o", path, "--set", "lidar_odometry.imu=always"],
        check=True,
    )
    stamps_ns, poses = read_poses_tum(path)
    read = (value_of(each, "nav_msgs/Odometry", "odom") for each in messages)
    moved = [each for each in read if isinstance(each, Odometry)]
    np.testing.assert_array_equal([each.stamp_ns for each in moved], stamps_ns)
    np.testing.assert_allclose(np.stack([each.pose for each in moved]), poses, atol=1e-7)
