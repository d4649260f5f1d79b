# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated car in a procedural town, recorded in the layout of KITTI odometry.

>>> from fusionslam.sim import SimConfig, TownConfig, record
>>> record(SimConfig(town=TownConfig(seed=7, blocks=(3, 2))), "another-town")  # doctest: +SKIP
"""

from fusionslam.sim.car import CarConfig, StereoConfig
from fusionslam.sim.drive import DriveConfig
from fusionslam.sim.lidar import LidarConfig
from fusionslam.sim.recorder import SimConfig, embedded_drive, embedded_folder, record
from fusionslam.sim.town import TownConfig

__all__ = [
    "CarConfig",
    "DriveConfig",
    "LidarConfig",
    "SimConfig",
    "StereoConfig",
    "TownConfig",
    "embedded_drive",
    "embedded_folder",
    "record",
]
