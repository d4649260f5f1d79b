# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""People who walk and cars that drive: on ways of their own, out of the robot's way."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from fusionslam.base.arrays import Floats, Integers
from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.mesh import Mesh, Paint, join_meshes, tapered_box, tube
from fusionslam.sim.motion.giving_way import STEP_S, Track, choose_moves, find_meetings
from fusionslam.sim.motion.occupancy import occupancy_of
from fusionslam.sim.motion.routes import RouteFinder
from fusionslam.sim.motion.smoothing import interpolate_path, lengths, smooth_path
from fusionslam.sim.movers import Mover
from fusionslam.sim.obstacles import move_times, speckles
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.town.street_furniture import car
from fusionslam.sim.town.textures import town_textures
from fusionslam.sim.world import World

_TRIES = 100
_PERSON_M = 0.3
"""Radius of a person's footprint, arms and stride included."""
_STEP_OVER_M, _HEAD_M = 0.2, 1.95
"""What is lower can be stepped on, what is higher walked under."""
_RESOLUTION_M = 0.05
_SHORTEST_M = 1.5
_CAR_M, _CAR_HALF_M = 1.15, 2.0
"""Discs that cover a car of 5.0 by 1.9 m, and from its middle to the last one."""
_NEAR_LANE_M = 25.0
_SKIN = ((0.95, 0.80, 0.69), (0.78, 0.57, 0.44), (0.45, 0.31, 0.23))


class MoversConfig(Section):
    """People who walk and cars that drive; they wait for the robot and for each other."""

    people: int = option(0, "people who walk", ge=0, le=200)
    cars: int = option(0, "cars that drive in the streets, if the world has any", ge=0, le=100)
    walk_m_s: float = option(1.2, "speed of people, each a fifth more or less", gt=0, le=3)
    drive_m_s: float = option(8.0, "speed of cars, each a fifth more or less", gt=0, le=20)
    path_m: float = option(12.0, "longest way of a person before it turns back", ge=_SHORTEST_M)
    near_m: float = option(3.0, "from the robot's path to the ends of people's ways", gt=0)
    distance_m: float = option(0.3, "least distance from the robot", unit="m", ge=0)


def plan_movers(
    config: MoversConfig,
    world: World,
    trajectory: Trajectory,
    robot_radius_m: float,
    seed: int,
    duration_s: float,
    others: Sequence[Mover] = (),
) -> tuple[Mover, ...]:
    """Plan people and cars that never meet the robot, each other, or what else moves.

    People walk between places near the robot's path, over ground that is free up to their height,
    and stand on what is lower than a step. Cars follow the world's lanes.

    Args:
        config: their numbers and speeds.
        world: on flat ground.
        trajectory: of the robot, which does not give way.
        robot_radius_m: radius of the robot's footprint.
        seed: decides everything else.
        duration_s: how long they move from the trajectory's start.
        others: what moves already.

    Raises:
        DataError: there is no room for that many, or no street for cars.
    """
    planner = _Planner(config, world, trajectory, robot_radius_m, seed, duration_s, others)
    cars = [planner.car(number) for number in range(config.cars)]
    return (*[planner.person(number) for number in range(config.people)], *cars)


class _Planner:
    def __init__(
        self,
        config: MoversConfig,
        world: World,
        trajectory: Trajectory,
        robot_radius_m: float,
        seed: int,
        duration_s: float,
        others: Sequence[Mover],
    ) -> None:
        self._config, self._world = config, world
        self._rng = np.random.default_rng([seed, 0x0C])
        self._seconds = move_times(trajectory, duration_s)
        x, y, yaw = trajectory.places(self._seconds)
        self._way = np.stack([x, y], axis=1)
        # A robot turns before it moves elsewhere: in each step it moves along itself.
        robot = Track.long(self._way, yaw, robot_radius_m + config.distance_m, 0.0)
        self._tracks = [robot, *(other.track for other in others)]

    def car(self, number: int) -> Mover:
        """Plan one more car on a lane near the robot's path."""
        from scipy.spatial import KDTree

        way = KDTree(self._way)
        lanes = [
            lane for lane in self._world.lanes if way.query(lane)[0].min(initial=99) < _NEAR_LANE_M
        ]
        for _ in range(_TRIES if lanes else 0):
            lane = lanes[self._rng.integers(len(lanes))]
            along = lengths(np.concatenate([lane, lane[:1]]))
            step = self._config.drive_m_s * self._rng.uniform(0.8, 1.2) * STEP_S
            stops = np.linspace(0, along[-1], round(along[-1] / step), endpoint=False)
            path = interpolate_path(stops, along, np.concatenate([lane, lane[:1]]))
            ahead = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0)
            track = Track.long(path, np.arctan2(ahead[:, 1], ahead[:, 0]), _CAR_M, _CAR_HALF_M)
            moves = choose_moves(find_meetings(track, self._tracks), self._rng, closed=True)
            if moves is not None:
                mesh = car(self._rng)
                used, texture = np.unique(mesh.texture, return_inverse=True)
                images = town_textures(0)
                mover = Mover(
                    replace(mesh, texture=texture.astype(np.int32)),
                    [images[k] for k in used],
                    _CAR_M,
                    self._seconds,
                    path[moves],
                    np.unwrap(track.yaw[moves]),
                    np.zeros(len(moves)),
                    _CAR_HALF_M,
                )
                self._tracks.append(mover.track)
                return mover
        raise _no_room("cars", self._config.cars, number)

    def person(self, number: int) -> Mover:
        """Plan one more person."""
        finder, near = self._finder, self._places
        for _ in range(_TRIES if len(near) > 1 else 0):
            start, end = self._rng.choice(near, 2, replace=False).tolist()
            apart = np.hypot(finder.x[start] - finder.x[end], finder.y[start] - finder.y[end])
            if not _SHORTEST_M <= apart <= self._config.path_m:
                continue
            cells = finder.way(start, end)
            corners = np.stack([finder.x[cells], finder.y[cells]], axis=1)
            smooth = smooth_path(corners, finder.room, finder.room, 0.0, self._rng)
            along = lengths(smooth)
            if along[-1] > self._config.path_m:
                continue
            step = self._config.walk_m_s * self._rng.uniform(0.8, 1.2) * STEP_S
            path = interpolate_path(np.arange(0, along[-1], step), along, smooth)
            track = Track.round(path, _PERSON_M)
            moves = choose_moves(find_meetings(track, self._tracks), self._rng)
            if moves is not None:
                places = path[moves]
                self._tracks.append(Track.round(places, _PERSON_M))
                mesh, height = _person(self._rng), self._heights(places)
                texture, yaw = [speckles()], _facing(places)
                return Mover(mesh, texture, _PERSON_M, self._seconds, places, yaw, height)
        raise _no_room("people", self._config.people, number)

    @cached_property
    def _finder(self) -> RouteFinder:
        """Ways for people, who are taller than most robots."""
        world = self._world
        grid = occupancy_of(
            world.collision,
            world.visual,
            low_m=_STEP_OVER_M,
            high_m=_HEAD_M,
            resolution_m=max(_RESOLUTION_M, world.map.resolution_m if world.map else 0.0),
        )
        # A cell's clearance is measured at its centre.
        return RouteFinder(grid, _PERSON_M + grid.resolution_m)

    @cached_property
    def _places(self) -> Integers:
        """Cells near the robot's path."""
        from scipy.spatial import KDTree

        cells = np.stack([self._finder.x, self._finder.y], axis=1)
        distance, _ = KDTree(self._way).query(cells, distance_upper_bound=self._config.near_m)
        return np.flatnonzero(np.isfinite(distance))

    @cached_property
    def _ground(self) -> RayCaster:
        return RayCaster(self._world.collision)

    def _heights(self, places: Floats) -> Floats:
        """Of the ground at places, (T,); 0 where there is none."""
        from_m = np.float32(_STEP_OVER_M)
        starts = np.column_stack([places, np.full(len(places), from_m)]).astype(np.float32)
        down = np.tile(np.array([0, 0, -1], np.float32), (len(places), 1))
        below = self._ground.cast(starts, down).distance.astype(np.float64)
        return np.where(below <= 2 * from_m, from_m - below, 0.0)


def _no_room(key: str, count: int, number: int) -> DataError:
    return DataError(
        f"movers.{key} is {count}: no room for number {number + 1} near the robot's way; fewer "
        "or slower ones may do, and cars need a world with streets",
        code="no-room",
        fields=(key, str(count), str(number + 1)),
    )


def _facing(places: Floats) -> Floats:
    """Direction of walking at each place, radians, continuous; while waiting that of before."""
    moves = np.diff(places, axis=0, append=places[-1:])
    walks = np.linalg.norm(moves, axis=1) > 0
    last = np.maximum.accumulate(np.where(walks, np.arange(len(moves)), -1))
    first = int(np.argmax(walks))
    at = np.where(last < 0, first, last)
    yaw: Floats = np.unwrap(np.arctan2(moves[at, 1], moves[at, 0]))
    return yaw


def _person(rng: np.random.Generator) -> Mesh:
    """A person of 1.55 to 1.9 m in mid-stride, who looks along x."""
    height = rng.uniform(1.55, 1.9)
    shirt, trousers = (tuple(rng.uniform(0.15, 0.9, 3).tolist()) for _ in range(2))
    cloth, legs = Paint(0, shirt), Paint(0, trousers)
    skin = Paint(0, _SKIN[rng.integers(len(_SKIN))])
    hip, shoulder, chin = 0.48 * height, 0.82 * height, 0.87 * height
    parts = [tapered_box((-0.12, -0.19, hip), (0.12, 0.19, shoulder), (0.8, 1.05), cloth)]
    for side in (-1, 1):
        foot, hand = (side * 0.16, side * 0.1, 0.0), (-side * 0.14, side * 0.25, 0.45 * height)
        parts.append(tube(foot, (0, side * 0.1, hip), (0.06, 0.09), legs, sides=8))
        parts.append(tube(hand, (0, side * 0.2, shoulder), (0.04, 0.05), cloth, sides=6))
    rings = [(shoulder, 0.06), (chin, 0.07), (0.93 * height, 0.095), (height, 0.001)]
    for (low, below), (high, above) in pairwise(rings):
        parts.append(tube((0, 0, low), (0, 0, high), (below, above), skin, sides=8))
    return join_meshes(parts)
