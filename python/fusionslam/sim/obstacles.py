# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Boxes that move back and forth near the robot's path."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Mask
from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.lidar import Vector
from fusionslam.sim.mesh import Mesh, Paint, box
from fusionslam.sim.motion.giving_way import STEP_S, Track, choose_moves, find_meetings
from fusionslam.sim.motion.occupancy import OccupancyMap
from fusionslam.sim.movers import Mover

_TRIES = 200
# Directions tried from each start; the box takes the one with the longest path.
_WAYS = 8
_SHORTEST_M = 1.0


class ObstacleConfig(Section):
    """Boxes that move on straight paths over free ground, and wait for the robot or back off."""

    number: int = option(0, "moving boxes", ge=0, le=100)
    size_m: Vector = option((0.5, 0.4, 1.2), "length, width, height; each box varies by a quarter")
    speed_m_s: float = option(0.5, "speed", unit="m/s", gt=0, le=10)
    path_m: float = option(5.0, "longest path before it turns back", unit="m", ge=_SHORTEST_M)
    near_m: float = option(
        4.0, "largest distance of a path's start from the robot's path", unit="m", gt=0
    )
    distance_m: float = option(0.3, "least distance between box and robot", unit="m", ge=0)


def plan_obstacles(
    config: ObstacleConfig,
    grid: OccupancyMap,
    trajectory: Trajectory,
    robot_radius_m: float,
    seed: int,
    duration_s: float | None = None,
) -> tuple[Mover, ...]:
    """Plan boxes that stay on free ground and never collide with each other or the robot.

    Args:
        config: number, size and speed of the boxes.
        grid: map of the free space.
        trajectory: of the robot, which does not give way.
        robot_radius_m: radius of the robot's footprint.
        seed: decides everything else.
        duration_s: how long they move from the trajectory's start; None: to its end.

    Raises:
        DataError: there is no room for that many boxes.
    """
    rng = np.random.default_rng([seed, 0x0B])
    whole = trajectory.duration_s
    duration = whole if duration_s is None else min(duration_s, whole)
    seconds = move_times(trajectory, duration)
    x, y, _ = trajectory.places(seconds)
    others = [Track.round(np.stack([x, y], axis=1), robot_radius_m + config.distance_m)]
    free = np.where(grid.reachable, grid.clearance(), 0.0)
    found: list[Mover] = []
    for number in range(config.number):
        obstacle = _plan_obstacle(config, grid, free, seconds, others, rng)
        if obstacle is None:
            raise DataError(
                f"obstacles.number is {config.number}: no room for number {number + 1} near the "
                "robot's way; fewer, smaller ones or a greater near_m may do",
                code="no-room",
                fields=(str(config.number), str(number + 1)),
            )
        found.append(obstacle)
        others.append(obstacle.track)
    return tuple(found)


def move_times(trajectory: Trajectory, duration_s: float) -> Floats:
    """Times from the trajectory's start at which places of movers are planned, float64 (T,)."""
    count = max(int(np.ceil(duration_s / STEP_S)), 1) + 1
    seconds: Floats = trajectory.seconds[0] + np.linspace(0.0, duration_s, count)
    return seconds


def _plan_obstacle(
    config: ObstacleConfig,
    grid: OccupancyMap,
    free: Floats,
    seconds: Floats,
    others: Sequence[Track],
    rng: np.random.Generator,
) -> Mover | None:
    """The first of many random boxes and paths that never collides with the others, or None."""
    length, width, height = np.asarray(config.size_m) * rng.uniform(0.75, 1.25, 3)
    radius = float(np.hypot(length, width) / 2)
    # A cell's clearance is measured at its centre.
    room, step = radius + grid.resolution_m, config.speed_m_s * STEP_S
    starts = _starts(grid, free >= room, others[0].places, config.near_m)
    for _ in range(_TRIES if len(starts) else 0):
        start, yaws = starts[rng.integers(len(starts))], rng.uniform(-np.pi, np.pi, _WAYS)
        paths = [_path(config, grid, free, start, yaw, step, room) for yaw in yaws]
        yaw, path = max(zip(yaws.tolist(), paths, strict=True), key=lambda way: len(way[1]))
        if len(path) * step < _SHORTEST_M:
            continue
        moves = choose_moves(find_meetings(Track.round(path, radius), others), rng)
        if moves is not None:
            mesh = _box(length, width, height, rng)
            still = np.zeros(len(seconds))
            return Mover(mesh, [speckles()], radius, seconds, path[moves], still + yaw, still)
    return None


def _starts(grid: OccupancyMap, roomy: Mask, way: Floats, near_m: float) -> Floats:
    """Centres of the cells with enough room near the robot's path, (N, 2)."""
    from scipy.spatial import KDTree

    cells = np.stack(grid.centres(*np.nonzero(roomy)), axis=1)
    distance, _ = KDTree(way).query(cells, distance_upper_bound=near_m)
    near: Floats = cells[np.isfinite(distance)]
    return near


def _path(
    config: ObstacleConfig,
    grid: OccupancyMap,
    free: Floats,
    start: Floats,
    yaw: float,
    step: float,
    room: float,
) -> Floats:
    """Points on a straight line from the start up to the first without room, (S, 2)."""
    along = np.arange(0.0, config.path_m, step)[:, None]
    line: Floats = start + along * np.array([np.cos(yaw), np.sin(yaw)])
    row, column, inside = grid.cells(line[:, 0], line[:, 1])
    blocked = ~inside | (free[row, column] < room)
    return line[: int(np.argmax(blocked)) if blocked.any() else len(line)]


def _box(length: float, width: float, height: float, rng: np.random.Generator) -> Mesh:
    red, green, blue = rng.uniform(0.25, 1.0, 3).tolist()
    corner = np.array([length / 2, width / 2, height])
    return box(corner * (-1, -1, 0), corner, Paint(texture=0, tint=(red, green, blue)))


def speckles() -> NDArray[np.uint8]:
    """Texture of boxes and clothes: grey speckles that take any tint, uint8 (32, 32, 4)."""
    grey = np.random.default_rng(0x0B).integers(150, 256, (32, 32, 1))
    return np.concatenate([np.repeat(grey, 3, axis=2), np.full((32, 32, 1), 255)], axis=2).astype(
        np.uint8
    )
