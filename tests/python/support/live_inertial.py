# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a live mapper with odometry of its own publishes of a bag with scans and IMU alone."""

from pathlib import Path
from typing import Any

import numpy as np

import bags
from fusionslam import open_dataset
from fusionslam.datasets.bags import open_bag
from fusionslam.datasets.bags.messages import value_of
from fusionslam.odometry import LidarOdometryConfig
from fusionslam.pipelines.lidar_odometry import track_lidar
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


def assert_same_odometry(messages: list[Any], bag: Path) -> None:
    """Odometry that was published is that of the recording, but for its quaternions."""
    dataset = open_dataset(bag, sensors=["points"])
    track = track_lidar(dataset, LidarOdometryConfig(imu="always"))
    read = (value_of(each, "nav_msgs/Odometry", "odom") for each in messages)
    moved = [each for each in read if isinstance(each, Odometry)]
    np.testing.assert_array_equal([each.stamp_ns for each in moved], track.stamps_ns)
    np.testing.assert_allclose(np.stack([each.pose for each in moved]), track.poses, atol=1e-12)
