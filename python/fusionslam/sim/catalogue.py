# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Find worlds by name or file, and get drives through them."""

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fusionslam.config import Section, merged, suggest
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.indoor import INDOOR_WORLDS
from fusionslam.sim.motion.occupancy import occupancy_of
from fusionslam.sim.motion.path_following import DriveLimits
from fusionslam.sim.motion.planner import PlanConfig, plan_trajectory
from fusionslam.sim.robot import RobotConfig
from fusionslam.sim.simulator import map_of
from fusionslam.sim.town.kitti_recorder import SimConfig
from fusionslam.sim.town.layout import TownConfig, make_town
from fusionslam.sim.town.route import lanes_around_blocks, make_drive
from fusionslam.sim.world import World
from fusionslam.sim.worlds import load_world

logger = logging.getLogger(__name__)

ROBOT = "turtlebot3_waffle_pi"
"""The default robot, unless a world suggests another one."""
_TOWN_CELL_M = 0.25
_PLAN_ROOM_M = 0.05
# Factor on a robot's limits: recorded drives have some noise.
_TOLERANCE = 1.1


class Entry(NamedTuple):
    """A procedural world: its settings, the function that builds it, and a suitable robot."""

    settings: Section
    make: Callable[[Any], World]
    robot: str


def town_world(config: TownConfig) -> World:
    """The town of the embedded drive, as on its first lap, with the trajectory of that drive.

    Raises:
        ConfigError: the town is too small for the drive.
    """
    whole = merged(SimConfig(), {"town": config.model_dump()})
    scene = make_town(config, lap=0)
    drive = make_drive(whole.drive, config.block_m, whole.seed)
    x, y = drive.poses[:, :2, 3].T
    yaw = np.unwrap(np.arctan2(drive.poses[:, 1, 0], drive.poses[:, 0, 0]))
    grid = occupancy_of(
        scene, low_m=0.2, high_m=2.0, resolution_m=_TOWN_CELL_M, start=(float(x[0]), float(y[0]))
    )
    way = Trajectory(drive.seconds, np.ascontiguousarray(x), np.ascontiguousarray(y), yaw)
    lanes = lanes_around_blocks(config.blocks, config.block_m)
    return World(name="town", visual=scene, collision=scene, map=grid, trajectory=way, lanes=lanes)


MADE: dict[str, Entry] = {
    name: Entry(entry.config(), entry.make, ROBOT) for name, entry in INDOOR_WORLDS.items()
} | {"town": Entry(TownConfig(), town_world, "car")}
"""Worlds that need no data, by name."""


def check_world(name: str) -> None:
    """Raise DataError unless the name is a procedural world or an existing path."""
    if name not in MADE and not Path(name).exists():
        raise DataError(
            f"{name}: no such world, file or folder, expected {', '.join(MADE)} or a path"
            f"{suggest(name, MADE)}"
        )


def read_world(path: str | Path, *, lenient: bool = False) -> World:
    """Read a world from a file or folder with ``load_world``; procedural worlds are not read here.

    Raises:
        DataError: no such world, or it cannot be read.
    """
    check_world(str(path))
    return load_world(path, lenient=lenient)


def drive_through(world: World, robot: RobotConfig, plan: PlanConfig) -> tuple[World, Trajectory]:
    """The world with a map, and its own drive or a planned one.

    Limits and clearance that ``plan`` does not set are taken from the robot.

    Raises:
        DataError: there is no room to drive.
    """
    grid = map_of(world, robot)
    whole = replace(world, map=grid)
    if world.trajectory is not None:
        _warn_of_haste(world.name, world.trajectory, robot.drive)
        return whole, world.trajectory
    try:
        drive = plan_trajectory(grid, merged(plan, limits_of(robot, plan)))
    except DataError as error:
        raise DataError(
            f"{world.name}: no drive for a robot of radius {robot.radius_m} m: {error}",
            code=error.code,
            fields=error.fields,
        ) from error
    logger.info("%s: planned %.1f m, %.1f s", world.name, drive.length_m, drive.duration_s)
    return whole, drive


def _warn_of_haste(name: str, drive: Trajectory, limits: DriveLimits) -> None:
    """Log a warning if a given drive exceeds the robot's limits; it is driven all the same."""
    gaps = np.diff(drive.seconds)
    speeds = np.hypot(np.diff(drive.x), np.diff(drive.y)) / gaps
    turns = np.abs(np.diff(drive.yaw)) / gaps
    for values, limit, unit in (
        (speeds, limits.max_speed_m_s, "m/s"),
        (turns, limits.max_turn_rad_s, "rad/s"),
    ):
        worst = int(np.argmax(values))
        if values[worst] > _TOLERANCE * limit:
            logger.warning(
                "%s: the drive is faster than the robot: %.2f %s at %.2f s, but its limit is %g %s",
                *(name, values[worst], unit, drive.seconds[worst], limit, unit),
            )


def limits_of(robot: RobotConfig, plan: PlanConfig) -> dict[str, Any]:
    """Limits and clearance of the robot that a plan does not set, as changes to the plan."""
    own = {"limits": robot.drive.model_dump(), "clearance_m": robot.radius_m + _PLAN_ROOM_M}
    return {key: value for key, value in own.items() if key not in plan.model_fields_set}
