# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated places: generated worlds, each seen from many poses, some close to each other."""

from collections.abc import Iterator
from typing import Literal

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.base.progress import Progress, reported
from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.learning.places import Sights
from fusionslam.sensors.frame import Cloud
from fusionslam.sim.indoor import (
    HospitalConfig,
    HouseConfig,
    IndoorConfig,
    WarehouseConfig,
    make_indoor,
)
from fusionslam.sim.lidar import LidarMount, scan
from fusionslam.sim.robot import RobotConfig, base_from, robot_named
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.simulator import map_of


class SimulatedPlacesConfig(Section):
    """The worlds, and the poses that they are seen from."""

    seed: int = option(0, "seed of worlds and poses", ge=0)
    kinds: tuple[Literal["house", "hospital", "warehouse"], ...] = option(
        ("house", "hospital", "warehouse"), "kinds of world, in turn", min_length=1
    )
    worlds: int = option(18, "number of worlds", ge=1, le=1000)
    places: int = option(60, "places in each world", ge=1)
    sights: int = option(6, "sights of each place", ge=2)
    spread_m: float = option(
        0.3, "largest offset of a sight from its place, in x and y", unit="m", ge=0
    )
    spread_deg: float = option(
        20.0, "largest rotation of a sight, to either side", unit="deg", ge=0
    )
    clearance_m: float = option(0.35, "free space around the robot's centre", unit="m", gt=0)
    ground_m: float = option(0.1, "points not above this are dropped", unit="m")
    least: int = option(50, "fewest points of a sight", ge=1)
    robot: str = option("turtlebot3_waffle_pi", "the robot; its first LiDAR records the sights")


def simulate_places(
    config: SimulatedPlacesConfig, progress: Progress | None = None
) -> Iterator[Sights]:
    """Simulate the sights of each world; the same configuration gives the same bytes.

    A point's colour is that of its surface as seen from the LiDAR.

    Raises:
        FusionSlamError: the simulator is not installed.
        DataError: the robot has no LiDAR, or a world has no free space for it.
    """
    robot = robot_named(config.robot)
    if not robot.lidars:
        raise DataError(f"{config.robot} has no LiDAR to see places with")
    for number in reported(range(config.worlds), progress, config.worlds):
        name = f"{config.kinds[number % len(config.kinds)]}_{number}"
        yield _simulate_sights(number, config, robot, name)


def _world_config(config: SimulatedPlacesConfig, number: int) -> IndoorConfig:
    rng = np.random.default_rng([config.seed, number, 0x50])
    seed = int(rng.integers(1000, 2**31))
    match config.kinds[number % len(config.kinds)]:
        case "house":
            return HouseConfig(seed=seed, rooms=int(rng.integers(5, 9)))
        case "hospital":
            return HospitalConfig(seed=seed, wards=int(rng.integers(4, 8)))
        case "warehouse":
            aisle = float(np.round(rng.uniform(1.8, 3.2), 2))
            return WarehouseConfig(
                seed=seed, rows=int(rng.integers(3, 6)), aisle_m=aisle, bay_types=6
            )


def _simulate_sights(
    number: int, config: SimulatedPlacesConfig, robot: RobotConfig, name: str
) -> Sights:
    world = make_indoor(_world_config(config, number))
    rng = np.random.default_rng([config.seed, number, 0x51])
    room = map_of(world, robot).inflate(config.clearance_m)
    rows, columns = np.nonzero(room.reachable)
    if not len(rows):
        raise DataError(f"{name}: no room for a robot with {config.clearance_m} m around it")
    chosen = rng.integers(len(rows), size=config.places)
    x, y = room.centres(rows[chosen], columns[chosen])
    middles = np.stack([x, y, rng.uniform(-np.pi, np.pi, config.places)], axis=1)
    around = np.repeat(middles, config.sights, axis=0)
    around[:, :2] += rng.uniform(-1, 1, (len(around), 2)) * config.spread_m
    around[:, 2] += np.deg2rad(rng.uniform(-1, 1, len(around)) * config.spread_deg)
    poses = around[room.is_free(around[:, 0], around[:, 1])]
    caster = RayCaster(world.visual)
    lidar = next(iter(robot.lidars.values()))
    base_from_lidar = base_from(robot, lidar.frame_id)
    clouds = [
        _simulate_cloud(caster, lidar, base_from_lidar, world_from_base, config, rng)
        for world_from_base in ground_poses(*poses.T)
    ]
    kept = [index for index, cloud in enumerate(clouds) if len(cloud) >= config.least]
    return name, [clouds[index] for index in kept], poses[kept]


def _simulate_cloud(
    caster: RayCaster,
    lidar: LidarMount,
    base_from_lidar: Floats,
    world_from_base: Floats,
    config: SimulatedPlacesConfig,
    rng: np.random.Generator,
) -> Cloud:
    """A sight without ground, in the robot's frame."""
    world_from_lidar = world_from_base @ base_from_lidar
    sweep = scan(caster, lidar, world_from_lidar, rng)
    points = sweep.points @ base_from_lidar[:3, :3].T.astype(np.float32)
    points += base_from_lidar[:3, 3].astype(np.float32)
    kept = points[:, 2] > config.ground_m
    rays = (sweep.points @ world_from_lidar[:3, :3].T.astype(np.float32))[kept]
    # Unit rays, so that hit parameters are distances.
    directions = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    pixel = float(abs(np.subtract(*(lidar.sector_rad or (-np.pi, np.pi)))) / lidar.azimuths)
    seen = caster.colors(sweep.hits[np.flatnonzero(kept)], directions, pixel)
    return Cloud(points[kept], np.rint(255 * seen.clip(0, 1)).astype(np.uint8))
