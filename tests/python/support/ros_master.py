# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS of a test's own, and a robot's drive to play there."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest

from benchmarks.ros.world import Listener, RosWorld, wait_until
from fusionslam.errors import FusionSlamError
from fusionslam.ros.ros1.environment import need_ros

__all__ = [
    "Listener",
    "PlayedBag",
    "RosWorld",
    "find_played_bag",
    "lacking",
    "needs_ros",
    "wait_until",
]

_METRES, _IMAGES_HZ = 8.0, 5.0


def _lacking() -> str:
    """Why there is no ROS; empty if there is."""
    try:
        need_ros()
    except FusionSlamError as error:
        return str(error)
    return "" if shutil.which("roscore") else "roscore is not on PATH: make ros installs it"


lacking = _lacking()
needs_ros = pytest.mark.needs_ros


@dataclass(frozen=True)
class PlayedBag:
    """A drive of some 20 s through a house, whose odometry is without errors.

    Attributes:
        path: of the bag, with /velodyne_points, /odom and /tf.
        image: topic of the camera's JPEG.
        camera_info: topic of its calibration.
        scans: how many there are.
    """

    path: Path
    image: str
    camera_info: str
    scans: int

    @property
    def sensors(self) -> tuple[str, str]:
        """Remappings of the nodes' topics."""
        image, info = f"image_raw:={self.image}", f"camera_info:={self.camera_info}"
        return f"camera/rgb/{image}", f"camera/rgb/{info}"


def find_played_bag(data: Path) -> PlayedBag:
    """That of the folder of test data; where there is none, one that is made, and kept for ever."""
    path = data / "bags" / "small_house_20s.bag"
    if path.is_file():
        return PlayedBag(path, "/camera/image/compressed", "/camera/camera_info", 40)
    from fusionslam.config import merged
    from fusionslam.sim.catalogue import MADE
    from fusionslam.sim.recordings import embedded_bag, recording_config

    changes = {
        "plan": {"length_m": _METRES},
        "robot": {"cameras": {"camera": {"rate_hz": _IMAGES_HZ}}},
    }
    path = embedded_bag("house", merged(recording_config(MADE["house"]), changes), jobs=2)
    return PlayedBag(path, "/camera/rgb/image_raw/compressed", "/camera/rgb/camera_info", 44)
