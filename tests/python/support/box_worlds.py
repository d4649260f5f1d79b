# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Small worlds of boxes whose ranges and pictures can be worked out by hand."""

from typing import Any

import numpy as np

from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.lidar import LidarMount
from fusionslam.sim.mesh import Paint, box, panels
from fusionslam.sim.robot import FrameConfig, RobotConfig
from fusionslam.sim.scene import Light
from fusionslam.sim.world import Part, World, scene_of

PLAIN = np.full((4, 4, 4), 255, np.uint8)
# What is lit equally from all sides, without haze: a surface's tint is its colour.
EVEN = Light(sun=(0.0, 0.0, 0.0), ambient=(1.0, 1.0, 1.0), visibility_m=1e9)
HALL = ((-6.0, -4.0), (6.0, 4.0))


def floor(half_m: float = 6.0) -> Part:
    corners = [[(-half_m, -half_m, 0), (half_m, -half_m, 0), (half_m, half_m, 0)]]
    corners[0].append((-half_m, half_m, 0))
    return Part("floor", panels(corners, Paint(0, (0.5, 0.5, 0.5))), is_ground=True)


Triple = tuple[float, float, float]


def block(name: str, low: Triple, high: Triple, tint: Triple = (1.0, 1.0, 1.0)) -> Part:
    return Part(name, box(low, high, Paint(0, tint)))


def hall() -> World:
    """12 x 8 m inside, walls 0.2 m thick and 2 m high, a red pillar and a low blue one.

    The blue one is missing among the collision shapes.
    """
    (x0, y0), (x1, y1) = HALL
    walls = [
        block("south", (x0 - 0.2, y0 - 0.2, 0), (x1 + 0.2, y0, 2)),
        block("north", (x0 - 0.2, y1, 0), (x1 + 0.2, y1 + 0.2, 2)),
        block("west", (x0 - 0.2, y0, 0), (x0, y1, 2)),
        block("east", (x1, y0, 0), (x1 + 0.2, y1, 2)),
        block("red", (2, -0.5, 0), (3, 0.5, 1.5), (1.0, 0.0, 0.0)),
    ]
    blue = block("blue", (-3, 2, 0), (-2, 3, 1.0), (0.0, 0.0, 1.0))
    visual = scene_of([floor(), *walls, blue], [PLAIN], EVEN)
    return World(name="hall", visual=visual, collision=scene_of([floor(), *walls], [PLAIN], EVEN))


def straight(seconds: float = 4.0, speed: float = 0.5) -> Trajectory:
    """From (-4, 0) along x."""
    times = np.array([0.0, seconds])
    return Trajectory(times, -4 + speed * times, np.zeros(2), np.zeros(2))


def bare_robot(**lidar: Any) -> RobotConfig:
    """One LiDAR without errors, 0.5 m above the ground and 0.1 m in front of the base."""
    perfect: dict[str, Any] = {
        "noise_m": 0.0,
        "dropout": 0.0,
        "grazing_dropout": 0.0,
        "far_dropout": 0.0,
    }
    mount: dict[str, Any] = {"position_m": (0.1, 0.0, 0.2), "parent": "mast", "shapes": "collision"}
    return RobotConfig(
        frames={"mast": FrameConfig(position_m=(0.0, 0.0, 0.3))},
        lidars={"lidar": LidarMount(**(perfect | mount | lidar))},
    )
