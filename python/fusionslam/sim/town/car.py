# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The sensors of the town's car in the embedded drive: a LiDAR and a stereo pair.

The robot description ``car`` has the same sensors: both take their values from the defaults of
``LidarConfig`` and ``LensConfig``.
"""

import numpy as np

from fusionslam.config import Section, option
from fusionslam.sim.camera import LensConfig
from fusionslam.sim.lidar import LidarConfig, Vector
from fusionslam.storage.arrays import Floats


class StereoConfig(LensConfig):
    """Two rectified colour cameras with half the resolution of KITTI's."""

    exposure: tuple[Vector, ...] = option(
        ((1.0, 1.0, 1.0), (0.70, 0.72, 0.78), (0.88, 0.86, 0.80)),
        "gain of red, green and blue on each lap (the last one serves later laps)",
        min_length=1,
    )


class CarConfig(Section):
    """The sensors and their mounting positions on the car."""

    lidar: LidarConfig = option(LidarConfig(), "the LiDAR")
    camera: StereoConfig = option(StereoConfig(), "the stereo pair")


def car_from_lidar(config: CarConfig) -> Floats:
    """Pose of the LiDAR in the car's frame, float64 (4, 4)."""
    pose = np.eye(4)
    pose[:3, 3] = config.lidar.position_m
    return pose
