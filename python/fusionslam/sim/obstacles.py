# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What moves back and forth on straight lines near the robot's path; boxes that do."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats
from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.lidar import Vector
from fusionslam.sim.mesh import Paint, box
from fusionslam.sim.motion.giving_way import (
    STEP_S,
    Track,
    choose_moves,
    find_meetings,
    move_times,
    robot_track,
)
from fusionslam.sim.motion.occupancy import OccupancyMap
from fusionslam.sim.movers import Mover

_TRIES = 200
# Directions tried from each start; the longest line is taken.
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


class Ground(NamedTuple):
    """Where something can walk.

    Attributes:
        grid: its map.
        free: float64 (rows, columns), metres from each cell to the nearest obstacle; 0 where it
            must not be.
    """

    grid: OccupancyMap
    free: Floats

    def plan_walk(
        self,
        others: Sequence[Track],
        rng: np.random.Generator,
        *,
        radius_m: float,
        speed_m_s: float,
        path_m: float,
        near_m: float,
    ) -> tuple[Track, NDArray[np.int64]] | None:
        """The first of many random lines on which it never meets the others, or None.

        Args:
            others: what it gives way to, first the robot, near whose path the line starts.
            rng: decides the line.
            radius_m: of its footprint.
            speed_m_s: its speed.
            path_m: longest line.
            near_m: from the robot's path.

        Returns:
            The line in steps, and the step at each time.
        """
        from scipy.spatial import KDTree

        # A cell's clearance is measured at its centre.
        room, step = radius_m + self.grid.resolution_m, speed_m_s * STEP_S
        cells = np.stack(self.grid.centres(*np.nonzero(self.free >= room)), axis=1)
        apart, _ = KDTree(others[0].places).query(cells, distance_upper_bound=near_m)
        starts = cells[np.isfinite(apart)]
        for _ in range(_TRIES if len(starts) else 0):
            start, yaws = starts[rng.integers(len(starts))], rng.uniform(-np.pi, np.pi, _WAYS)
            lines = [self._line(start, yaw, path_m, step, room) for yaw in yaws]
            yaw, line = max(zip(yaws.tolist(), lines, strict=True), key=lambda way: len(way[1]))
            if len(line) * step < _SHORTEST_M:
                continue
            track = Track(line, np.full(len(line), yaw), radius_m)
            moves = choose_moves(find_meetings(track, others), rng)
            if moves is not None:
                return track, moves
        return None

    def _line(self, start: Floats, yaw: float, longest: float, step: float, room: float) -> Floats:
        """Points on a straight line from the start up to the first without room, (S, 2)."""
        along = np.arange(0.0, longest, step)[:, None]
        line: Floats = start + along * np.array([np.cos(yaw), np.sin(yaw)])
        row, column, inside = self.grid.cells(line[:, 0], line[:, 1])
        blocked = ~inside | (self.free[row, column] < room)
        return line[: int(np.argmax(blocked)) if blocked.any() else len(line)]


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
    seconds = move_times(trajectory, whole if duration_s is None else min(duration_s, whole))
    others = [robot_track(trajectory, seconds, robot_radius_m + config.distance_m)]
    ground = Ground(grid, np.where(grid.reachable, grid.clearance(), 0.0))
    found: list[Mover] = []
    for number in range(config.number):
        length, width, height = np.asarray(config.size_m) * rng.uniform(0.75, 1.25, 3)
        walk = ground.plan_walk(
            others,
            rng,
            radius_m=float(np.hypot(length, width) / 2),
            speed_m_s=config.speed_m_s,
            path_m=config.path_m,
            near_m=config.near_m,
        )
        if walk is None:
            raise DataError(
                f"obstacles.number is {config.number}: no room for number {number + 1} near the "
                "robot's way; fewer, smaller ones or a greater near_m may do",
                code="no-room",
                fields=(str(config.number), str(number + 1)),
            )
        line, moves = walk
        track = Track(line.places[moves], line.yaw[moves], line.radius_m)
        red, green, blue = rng.uniform(0.25, 1.0, 3).tolist()
        corner = np.array([length / 2, width / 2, height])
        mesh = box(corner * (-1, -1, 0), corner, Paint(texture=0, tint=(red, green, blue)))
        found.append(Mover(mesh, [speckles()], seconds, track))
        others.append(track)
    return tuple(found)


def speckles() -> NDArray[np.uint8]:
    """Texture of boxes and clothes: grey speckles that take any tint, uint8 (32, 32, 4)."""
    grey = np.random.default_rng(0x0B).integers(150, 256, (32, 32, 1))
    return np.concatenate([np.repeat(grey, 3, axis=2), np.full((32, 32, 1), 255)], axis=2).astype(
        np.uint8
    )
