# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The sensors of the town's car: a LiDAR, and a stereo pair or four cameras all round.

The robot description ``car`` has the same LiDAR and stereo pair: both take their values from the
defaults of ``LidarConfig`` and ``LensConfig``.
"""

from typing import Literal

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.config import Section, option
from fusionslam.geometry.rigid import rotation
from fusionslam.sim.camera import LensConfig, parent_from_camera
from fusionslam.sim.lidar import LidarConfig, Vector

RING = {"left": 0.0, "side_left": 90.0, "rear": 180.0, "side_right": -90.0}
"""Yaw of the four cameras in degrees; "left" looks ahead, as the main camera of any recording."""


class StereoConfig(LensConfig):
    """Two rectified colour cameras with half the resolution of KITTI's."""

    exposure: tuple[Vector, ...] = option(
        ((1.0, 1.0, 1.0), (0.70, 0.72, 0.78), (0.88, 0.86, 0.80)),
        "gain of red, green and blue on each lap (the last one serves later laps)",
        min_length=1,
    )


class RingConfig(StereoConfig):
    """Four cameras that look ahead, to the left, back and to the right, 100 degrees each.

    ``position_m`` and ``tilt_deg`` are those of the one that looks ahead; the others are turned
    about the car's origin. ``baseline_m`` has no effect. The images reach far enough down for the
    lowest beam of the LiDAR.
    """

    width: int = option(300, "columns", unit="px", ge=8, le=4096)
    height: int = option(111, "rows", unit="px", ge=8, le=4096)
    focal_px: float = option(126.0, "focal length", unit="px", gt=0)
    centre_px: tuple[float, float] = option((149.5, 15.0), "principal point", unit="px")
    gains: tuple[Vector, Vector, Vector, Vector] = option(
        ((1.0, 1.0, 1.0), (0.84, 0.88, 0.92), (1.12, 1.06, 1.00), (0.95, 1.00, 1.08)),
        "gain of red, green and blue of each camera, beside that of the lap: ahead, left, back, "
        "right",
    )


class CarConfig(Section):
    """The sensors and their mounting positions on the car."""

    lidar: LidarConfig = option(LidarConfig(), "the LiDAR")
    camera: StereoConfig = option(StereoConfig(), "the stereo pair")
    cameras: Literal["stereo", "four"] = option(
        "stereo",
        "stereo: the pair, recorded in the layout of KITTI odometry; four: a camera to each side "
        "(ring), recorded as a plain folder",
    )
    ring: RingConfig = option(RingConfig(), "the four cameras")


def car_from_ring_camera(config: RingConfig, name: str) -> Floats:
    """Pose of one of the ``RING`` in the car's frame, float64 (4, 4)."""
    turned = np.eye(4)
    turned[:3, :3] = rotation((0.0, 0.0, float(np.deg2rad(RING[name]))))
    return turned @ parent_from_camera(config)


def car_from_lidar(config: CarConfig) -> Floats:
    """Pose of the LiDAR in the car's frame, float64 (4, 4)."""
    pose = np.eye(4)
    pose[:3, 3] = config.lidar.position_m
    return pose
