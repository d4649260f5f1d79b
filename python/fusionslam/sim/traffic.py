# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""People who walk and cars that drive, out of the robot's way."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, product

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.mesh import Mesh, Paint, join_meshes, tapered_box, tube
from fusionslam.sim.motion.giving_way import (
    STEP_S,
    Track,
    choose_moves,
    find_meetings,
    move_times,
    robot_track,
)
from fusionslam.sim.motion.occupancy import OccupancyMap, occupancy_of
from fusionslam.sim.motion.smoothing import interpolate_path, lengths
from fusionslam.sim.movers import Mover
from fusionslam.sim.obstacles import Ground, speckles
from fusionslam.sim.scene import RayCaster
from fusionslam.sim.world import World

_TRIES = 100
_DISTANCE_M = 0.3
"""From the robot, at least."""
_PERSON_M = 0.3
"""Radius of a person's footprint, arms and stride included."""
_STEP_OVER_M, _HEAD_M = 0.2, 1.95
"""What is lower can be stepped on, what is higher walked under."""
_CAR_M, _CAR_HALF_M = 1.15, 2.0
"""Discs that cover a car of 5.0 by 1.9 m, and from its middle to the last one."""
_ROAD_M = 2.4
"""From the middle of a lane, within which people do not walk."""
_SKIN = ((0.95, 0.80, 0.69), (0.78, 0.57, 0.44), (0.45, 0.31, 0.23))


class MoversConfig(Section):
    """People who walk and cars that drive; they wait for the robot and for each other."""

    people: int = option(0, "people who walk to and fro near the robot's path", ge=0, le=200)
    cars: int = option(0, "cars that drive on the world's lanes; towns have some", ge=0, le=100)
    walk_m_s: float = option(
        1.2, "speed of people, each up to a fifth more or less", unit="m/s", gt=0, le=3
    )
    drive_m_s: float = option(
        8.0, "speed of cars, each up to a fifth more or less", unit="m/s", gt=0, le=20
    )
    path_m: float = option(10.0, "longest way of a person before it turns back", unit="m", ge=1)
    near_m: float = option(
        6.0, "largest distance of such a way's start from the robot's path", unit="m", gt=0
    )


def plan_movers(
    config: MoversConfig,
    world: World,
    grid: OccupancyMap,
    trajectory: Trajectory,
    robot_radius_m: float,
    seed: int,
    duration_s: float,
    others: Sequence[Mover] = (),
) -> tuple[Mover, ...]:
    """Plan people and cars that never meet the robot, each other, or what else moves.

    Args:
        config: their numbers and speeds.
        world: on flat ground.
        grid: map of the robot's free space.
        trajectory: of the robot, which does not give way.
        robot_radius_m: radius of the robot's footprint.
        seed: decides everything else.
        duration_s: how long they move from the trajectory's start.
        others: what moves already.

    Raises:
        DataError: there is no room for that many, or the world has no lanes for cars.
    """
    rng = np.random.default_rng([seed, 0x0C])
    seconds = move_times(trajectory, duration_s)
    robot = robot_track(trajectory, seconds, robot_radius_m + _DISTANCE_M)
    tracks = [robot, *(other.track for other in others)]
    found: list[Mover] = []

    def add(mover: Mover | None, key: str, number: int) -> None:
        if mover is None:
            count = getattr(config, key)
            raise DataError(
                f"movers.{key} is {count}: no room for number {number + 1}; fewer or slower ones "
                "may do, and cars need a world with lanes, such as the town",
                code="no-room",
                fields=(key, str(count), str(number + 1)),
            )
        found.append(mover)
        tracks.append(mover.track)

    for number in range(config.cars):
        add(_plan_car(config, world.lanes, seconds, tracks, rng), "cars", number)
    if config.people:
        ground, surface = _walkable(world, grid), RayCaster(world.collision)
        for number in range(config.people):
            add(_plan_person(config, ground, surface, seconds, tracks, rng), "people", number)
    return tuple(found)


def _plan_car(
    config: MoversConfig,
    lanes: Sequence[Floats],
    seconds: Floats,
    tracks: Sequence[Track],
    rng: np.random.Generator,
) -> Mover | None:
    for _ in range(_TRIES if lanes else 0):
        lane = lanes[int(rng.integers(len(lanes)))]
        closed = np.concatenate([lane, lane[:1]])
        along = lengths(closed)
        step = config.drive_m_s * rng.uniform(0.8, 1.2) * STEP_S
        stops = np.linspace(0, along[-1], round(along[-1] / step), endpoint=False)
        path = interpolate_path(stops, along, closed)
        ahead = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0)
        whole = Track(path, np.arctan2(ahead[:, 1], ahead[:, 0]), _CAR_M, _CAR_HALF_M)
        moves = choose_moves(find_meetings(whole, tracks), rng, closed=True)
        if moves is not None:
            track = replace(whole, places=path[moves], yaw=np.unwrap(whole.yaw[moves]))
            return Mover(_car(rng), [speckles()], seconds, track)
    return None


def _plan_person(
    config: MoversConfig,
    ground: Ground,
    surface: RayCaster,
    seconds: Floats,
    tracks: Sequence[Track],
    rng: np.random.Generator,
) -> Mover | None:
    walk = ground.plan_walk(
        tracks,
        rng,
        radius_m=_PERSON_M,
        speed_m_s=config.walk_m_s * rng.uniform(0.8, 1.2),
        path_m=config.path_m,
        near_m=config.near_m,
    )
    if walk is None:
        return None
    line, moves = walk
    places = line.places[moves]
    steps = np.diff(moves, append=moves[-1:])
    last = np.maximum.accumulate(np.where(steps != 0, np.arange(len(steps)), 0))
    track = Track(places, line.yaw[moves] + np.pi * (steps[last] < 0), _PERSON_M)
    # Rays down from above what can be stepped on; where none ends there, the ground is z = 0.
    starts = np.column_stack([places, np.full(len(places), _STEP_OVER_M)]).astype(np.float32)
    down = np.tile(np.array([0, 0, -1], np.float32), (len(places), 1))
    below = surface.cast(starts, down).distance.astype(np.float64)
    height = np.where(below < 2 * _STEP_OVER_M, _STEP_OVER_M - below, 0.0)
    return Mover(_person(rng), [speckles()], seconds, track, height)


def _walkable(world: World, grid: OccupancyMap) -> Ground:
    """Where people fit up to their heads, on ground that the robot could reach, beside lanes."""
    from scipy.ndimage import distance_transform_edt

    tall = occupancy_of(
        world.collision,
        world.visual,
        low_m=_STEP_OVER_M,
        high_m=_HEAD_M,
        resolution_m=grid.resolution_m,
    )
    free = tall.clearance()
    rows, columns = np.indices(free.shape)
    free[~grid.is_free(*tall.centres(rows, columns))] = 0.0
    if world.lanes:
        row, column, inside = tall.cells(*np.concatenate(world.lanes).T)
        beside = np.ones(free.shape, bool)
        beside[row[inside], column[inside]] = False
        free[distance_transform_edt(beside) * tall.resolution_m < _ROAD_M] = 0.0
    return Ground(tall, free)


def _car(rng: np.random.Generator) -> Mesh:
    """A car of 3.9 to 4.9 m by 1.8 m, which drives along x."""
    half, height, shade = rng.uniform(1.95, 2.45), rng.uniform(1.4, 1.9), rng.uniform(0.2, 0.9, 3)
    lacquer, glass, rubber = (Paint(0, (r, g, b)) for r, g, b in (shade, [0.3] * 3, [0.1] * 3))
    shoulder = 0.58 * height
    parts = [tapered_box((-half, -0.9, 0.22), (half, 0.9, shoulder), (0.97, 0.94), lacquer)]
    parts.append(
        tapered_box((-0.9 * half, -0.8, shoulder), (0.4 * half, 0.8, height), (0.8, 0.8), glass)
    )
    for x, y in product((-0.62 * half, 0.62 * half), (-0.78, 0.78)):
        ends = (x, y - 0.1, 0.32), (x, y + 0.1, 0.32)
        parts.append(tube(*ends, (0.32, 0.32), rubber, sides=10))
    return join_meshes(parts)


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
