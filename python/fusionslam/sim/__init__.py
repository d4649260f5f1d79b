# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated worlds and the robots that drive through them.

``simulate`` yields what a robot publishes; ``record`` writes the embedded drive, a car in a
procedural town, in the layout of KITTI odometry.

>>> from fusionslam.sim import SimConfig, TownConfig, record
>>> record(SimConfig(town=TownConfig(seed=7, blocks=(3, 2))), "another-town")  # doctest: +SKIP
"""

from fusionslam.sim.lidar import LidarConfig
from fusionslam.sim.robot import RobotConfig, robot_named
from fusionslam.sim.simulator import SimulationConfig, simulate
from fusionslam.sim.town.car import CarConfig, StereoConfig
from fusionslam.sim.town.kitti_recorder import SimConfig, embedded_drive, embedded_folder, record
from fusionslam.sim.town.layout import TownConfig
from fusionslam.sim.town.route import DriveConfig

__all__ = [
    "CarConfig",
    "DriveConfig",
    "LidarConfig",
    "RobotConfig",
    "SimConfig",
    "SimulationConfig",
    "StereoConfig",
    "TownConfig",
    "embedded_drive",
    "embedded_folder",
    "record",
    "robot_named",
    "simulate",
]
