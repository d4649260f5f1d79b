# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""On a live ROS 1, mapper without /odom publishes the odometry that the recording gives."""

import sys
from pathlib import Path

import pytest

from live_inertial import MAPPER, assert_same_odometry, write_sensors
from ros_master import RosWorld, needs_ros

pytestmark = [needs_ros, pytest.mark.nightly]
pytest.importorskip("rko_lio", reason="the library of odometry by LiDAR and IMU is an extra")


def test_odometry_of_scans_and_imu_is_that_of_the_recording(tmp_path: Path) -> None:
    bag = write_sensors(tmp_path / "sensors.bag")
    with RosWorld(tmp_path) as world:
        # mapper never ceases to publish /tf, so only /odom tells that it has done all.
        listener, links = world.listen("/odom"), world.listen("/tf")
        node = world.node("mapper", *MAPPER)
        world.play(bag, "-r", "2")
        listener.settle()
        assert world.end(node) == 0, world.log("mapper")
        found, linked = listener.messages()["/odom"], links.messages()["/tf"]
    assert_same_odometry(found, [sys.executable, "-m", "fusionslam"], bag)
    frames = [each.header.frame_id for message in linked for each in message.transforms]
    assert frames.count("odom") == len(found)
