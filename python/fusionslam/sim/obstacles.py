# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Boxes that move back and forth near the robot's path, and the world with them in it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Floats32, Mask
from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.lidar import Vector
from fusionslam.sim.mesh import Mesh, Paint, box, join_meshes
from fusionslam.sim.motion.occupancy import OccupancyMap
from fusionslam.sim.scene import Hits, RayCaster, Scene

_STEP_S = 0.1
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


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A moving box and its positions over time.

    Attributes:
        mesh: the box centred on the z axis, on the ground, x along its path.
        radius_m: of the circle around its footprint.
        seconds: float64 (T,), times, on the clock of the robot's trajectory.
        places: float64 (T, 2), x, y in metres at these times, interpolated linearly.
        yaw: direction of the path, radians.
    """

    mesh: Mesh
    radius_m: float
    seconds: Floats
    places: Floats
    yaw: float

    def at(self, seconds: float) -> Mesh:
        """The box in the world at a time; it stands still before the first and after the last."""
        x, y = (np.interp(seconds, self.seconds, axis) for axis in self.places.T)
        return self.mesh.move((x, y, 0.0), self.yaw)


def plan_obstacles(
    config: ObstacleConfig,
    grid: OccupancyMap,
    trajectory: Trajectory,
    robot_radius_m: float,
    seed: int,
    duration_s: float | None = None,
) -> tuple[Obstacle, ...]:
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
    count = max(int(np.ceil(duration / _STEP_S)), 1) + 1
    seconds = trajectory.seconds[0] + np.linspace(0.0, duration, count)
    x, y, _ = trajectory.places(seconds)
    others = [(np.stack([x, y], axis=1), robot_radius_m + config.distance_m)]
    free = np.where(grid.reachable, grid.clearance(), 0.0)
    found: list[Obstacle] = []
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
        others.append((obstacle.places, obstacle.radius_m))
    return tuple(found)


def _plan_obstacle(
    config: ObstacleConfig,
    grid: OccupancyMap,
    free: Floats,
    seconds: Floats,
    others: Sequence[tuple[Floats, float]],
    rng: np.random.Generator,
) -> Obstacle | None:
    """The first of many random boxes and paths that never collides with the others, or None."""
    length, width, height = np.asarray(config.size_m) * rng.uniform(0.75, 1.25, 3)
    radius = float(np.hypot(length, width) / 2)
    # A cell's clearance is measured at its centre.
    room, step = radius + grid.resolution_m, config.speed_m_s * _STEP_S
    starts = _starts(grid, free >= room, others[0][0], config.near_m)
    for _ in range(_TRIES if len(starts) else 0):
        start, yaws = starts[rng.integers(len(starts))], rng.uniform(-np.pi, np.pi, _WAYS)
        paths = [_path(config, grid, free, start, yaw, step, room) for yaw in yaws]
        yaw, path = max(zip(yaws.tolist(), paths, strict=True), key=lambda way: len(way[1]))
        if len(path) * step < _SHORTEST_M:
            continue
        moves = _moves(_meets(path, radius, others), rng)
        if moves is not None:
            mesh = _box(length, width, height, rng)
            return Obstacle(mesh, radius, seconds, path[moves], yaw)
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


def _meets(path: Floats, radius: float, others: Sequence[tuple[Floats, float]]) -> Mask:
    """True where a box at a point of its path would touch another at a time, bool (T, S)."""
    meets = np.zeros((len(others[0][0]), len(path)), dtype=bool)
    own = np.linalg.norm(path[1] - path[0])
    for places, other_radius in others:
        distance = np.linalg.norm(places[:, None] - path[None], axis=2)
        step = np.linalg.norm(np.diff(places, axis=0), axis=1).max(initial=0)
        # Between two times each of them comes closer by half a step at most.
        meets |= distance < radius + other_radius + (own + step) / 2
    return meets


def _moves(meets: Mask, rng: np.random.Generator) -> NDArray[np.int64] | None:
    """Index on the path at each time, (T,), moving back and forth without a collision.

    Backward pass: a point is safe at a time if it is free then and a point that is safe at the
    next time is within reach. None if no point is safe at the start.
    """
    safe = ~meets
    for time in range(len(safe) - 2, -1, -1):
        after = safe[time + 1]
        reach = after.copy()
        reach[1:] |= after[:-1]
        reach[:-1] |= after[1:]
        safe[time] &= reach
    starts = np.flatnonzero(safe[0])
    if not len(starts):
        return None
    place, ahead = int(rng.choice(starts)), 1
    way = [place]
    for row in safe[1:]:
        if not 0 <= place + ahead < len(row):
            ahead = -ahead
        choices = (place + ahead, place, place - ahead)
        place = next(k for k in choices if 0 <= k < len(row) and row[k])
        way.append(place)
    return np.array(way)


def _box(length: float, width: float, height: float, rng: np.random.Generator) -> Mesh:
    red, green, blue = rng.uniform(0.25, 1.0, 3).tolist()
    corner = np.array([length / 2, width / 2, height])
    return box(corner * (-1, -1, 0), corner, Paint(texture=0, tint=(red, green, blue)))


def _speckles() -> NDArray[np.uint8]:
    """Texture of the boxes: grey speckles that take any tint, uint8 (32, 32, 4)."""
    grey = np.random.default_rng(0x0B).integers(150, 256, (32, 32, 1))
    return np.concatenate([np.repeat(grey, 3, axis=2), np.full((32, 32, 1), 255)], axis=2).astype(
        np.uint8
    )


class _Share(NamedTuple):
    """The hits of one caster: their rows among all hits, and the hits with its own indices."""

    caster: RayCaster
    rows: slice | NDArray[np.intp]
    hits: Hits


class Crowd:
    """A static world with moving boxes in it at one point in time; a ``Caster``.

    Triangles and objects of the boxes are numbered after those of the world.
    """

    def __init__(self, rest: RayCaster, scene: Scene, boxes: Sequence[Mesh] = ()) -> None:
        self._rest, self._count = rest, len(scene.mesh)
        self._names = len(scene.names)
        self._moving: RayCaster | None = None
        if boxes:
            self._moving = RayCaster(Scene(join_meshes(boxes), [_speckles()], scene.light))
            sizes = [len(mesh) for mesh in boxes]
            self._box = np.repeat(np.arange(len(boxes), dtype=np.int32), sizes)

    def cast(self, origin: Floats32, directions: Floats32) -> Hits:
        """First hits of rays from ``origin`` (3,) or (R, 3) along ``directions`` (R, 3)."""
        rest = self._rest.cast(origin, directions)
        if self._moving is None:
            return rest
        boxes = self._moving.cast(origin, directions)
        near = boxes.distance < rest.distance
        return Hits(
            np.where(near, boxes.distance, rest.distance),
            np.where(near, boxes.triangle + np.int32(self._count), rest.triangle),
            np.where(near, boxes.u, rest.u),
            np.where(near, boxes.v, rest.v),
        )

    def incidence(self, hits: Hits, directions: Floats32) -> Floats32:
        """Cosine between ray and surface normal, (R,)."""
        return self._join(hits, lambda own: own.caster.incidence(own.hits, directions[own.rows]))

    def brightness(self, hits: Hits) -> Floats32:
        """Grey value of the surface at each hit, (R,)."""
        return self._join(hits, lambda own: own.caster.brightness(own.hits))

    def colors(self, hits: Hits, directions: Floats32, pixel: float) -> Floats32:
        """RGB that a camera sees along each ray, (R, 3)."""
        return self._join(
            hits, lambda own: own.caster.colors(own.hits, directions[own.rows], pixel)
        )

    def objects(self, hits: Hits) -> NDArray[np.uint16]:
        """Number of the object at each hit, counted from 1, boxes last; 0 if unknown."""
        number = np.zeros(len(hits.triangle), np.uint16)
        rest, *boxes = self._split(hits)
        number[rest.rows] = self._rest.part_of(rest.hits) + 1
        for part in boxes:
            number[part.rows] = self._names + 1 + self._box[part.hits.triangle]
        return number

    def _join(self, hits: Hits, values_of: Callable[[_Share], Floats32]) -> Floats32:
        """Values of each hit, by the caster that it belongs to."""
        shares = self._split(hits)
        parts = [values_of(share) for share in shares]
        joined = np.empty((len(hits.distance), *parts[0].shape[1:]), np.float32)
        for share, part in zip(shares, parts, strict=True):
            joined[share.rows] = part
        return joined

    def _split(self, hits: Hits) -> list[_Share]:
        """The hits on the static world, then, if there are any, the hits on the boxes."""
        boxes = np.flatnonzero(hits.triangle >= self._count)
        if self._moving is None or not len(boxes):
            return [_Share(self._rest, slice(None), hits)]
        rest = np.flatnonzero(hits.triangle < self._count)
        found = hits[boxes]
        own = Hits(found.distance, found.triangle - np.int32(self._count), found.u, found.v)
        return [_Share(self._rest, rest, hits[rest]), _Share(self._moving, boxes, own)]
