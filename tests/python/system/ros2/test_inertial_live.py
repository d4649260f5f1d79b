# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""On a live ROS 2, mapper without /odom publishes the odometry that the recording gives."""

from pathlib import Path

import pytest

from benchmarks.ros.ros2_world import Ros2World, fusionslam, lacking
from live_inertial import MAPPER_2, assert_same_odometry, write_sensors

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(bool(lacking), reason=lacking)]
pytest.importorskip("rko_lio", reason="the library of odometry by LiDAR and IMU is an extra")


def test_odometry_of_scans_and_imu_is_that_of_the_recording(tmp_path: Path) -> None:
    bag = write_sensors(tmp_path / "sensors.bag")
    with Ros2World(tmp_path) as world:
        listener = world.listen("/odom")
        world.node("mapper", *MAPPER_2)
        listener.wait_for("/odom")
        world.play(bag, "--rate", "2", "--until-idle")
        listener.settle(1.0)
        assert_same_odometry(listener.messages()["/odom"], fusionslam(), bag)
