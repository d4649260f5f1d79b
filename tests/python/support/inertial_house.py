# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A recording of a robot with a LiDAR and an IMU that drives through a house."""

from pathlib import Path

import pytest

from artefacts import artefact
from fusionslam.sim.catalogue import MADE, drive_through
from fusionslam.sim.recordings import recording_config, write_recording
from fusionslam.sim.robot import ImuMount


def inertial_house() -> Path:
    """A bag of 5 s with sweeps at 10 Hz; the IMU is turned by 90 degrees."""
    pytest.importorskip("embreex")
    return artefact("inertial-house", _make) / "house.bag"


def _make(folder: Path) -> None:
    entry = MADE["house"]
    config = recording_config(entry, "turtlebot3_vlp16")
    imu = ImuMount(position_m=(0.1, -0.05, 0.3), tilt_deg=(0, 0, 90))
    robot = config.robot.model_copy(update={"cameras": {}, "imus": {"imu": imu}})
    config = config.model_copy(update={"robot": robot, "seconds": 5.0})
    place, drive = drive_through(entry.make(entry.settings), robot, config.plan)
    write_recording(place, drive, config, folder / "house.bag", jobs=2)
