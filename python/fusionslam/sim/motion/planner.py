# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Plan drives through a whole map that revisit places in the same and the opposite direction."""

from collections.abc import Iterator
from itertools import cycle

import numpy as np
from pydantic import model_validator

from fusionslam.base.arrays import Floats, Integers
from fusionslam.config import Section, option
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.motion.occupancy import OccupancyMap
from fusionslam.sim.motion.path_following import DriveLimits, drive
from fusionslam.sim.motion.routes import RouteFinder, round_trip, spread_cells, tour_cost
from fusionslam.sim.motion.smoothing import lengths, smooth_path

# Smoothing shortens paths: the planned length is this factor times the driven length.
_RESERVE = 1.2
_STARTS = 4
# Where a path turns by more than this, the robot stops and turns on the spot.
_SHARP_RAD = np.deg2rad(100)
# The turn at a way-point is measured over this many metres before and after it.
_LOOK_M = 0.4


class PlanConfig(Section):
    """A tour through the whole map, with a part repeated and a part driven in reverse."""

    seed: int = option(0, "decides way-points and drift", ge=0)
    length_m: float | None = option(
        None,
        "length of the drive; none: long enough for the whole tour",
        unit="m",
        ge=2,
        le=1e5,
    )
    spacing_m: float = option(
        3.0, "the tour passes every reachable place at about this distance", unit="m", ge=1, le=100
    )
    again: float = option(
        0.3, "share of the length that repeats the tour in the same direction", ge=0, le=0.8
    )
    back: float = option(
        0.3, "share of the length that repeats it in the opposite direction", ge=0, le=0.8
    )
    clearance_m: float = option(
        0.25, "least distance of the robot's centre from obstacles", unit="m", gt=0, le=10
    )
    wander_m: float = option(
        0.1,
        "standard deviation of a slow sideways drift; less in narrow places",
        unit="m",
        ge=0,
        le=2,
    )
    limits: DriveLimits = option(DriveLimits(), "limits of the robot")

    @model_validator(mode="after")
    def _some_is_left_for_the_tour(self) -> "PlanConfig":
        if self.again + self.back > 0.9:
            raise ValueError(f"again + back is {self.again + self.back}, expected at most 0.9")
        return self


def plan_trajectory(grid: OccupancyMap, config: PlanConfig) -> Trajectory:
    """A drive over the reachable area that revisits places in both directions.

    Way-points spread over the area are joined into a round trip, which is driven once, then partly
    repeated, then partly driven in the opposite direction, and so on until the length is reached.
    The whole drive keeps the clearance. The same map and configuration give the same poses, bit
    for bit.

    Raises:
        DataError: the map has no room, or hardly any, for a robot with this clearance.
    """
    rng = np.random.default_rng([config.seed, 0x9A7])
    # Two cells of extra clearance, within which smoothing may move the path.
    finder = RouteFinder(grid, config.clearance_m + 2 * grid.resolution_m)
    bounds = grid.inflate(config.clearance_m)
    tour, length_m = _tour(finder, config, rng)
    paths = _join_legs(_legs(finder, tour, length_m, config, rng))
    smooth = [smooth_path(path, finder.room, bounds, config.wander_m, rng) for path in paths]
    return drive(_shorten_paths(smooth, length_m), config.limits)


def _tour(
    finder: RouteFinder, config: PlanConfig, rng: np.random.Generator
) -> tuple[Integers, float]:
    """Cells of a round trip, and the length of the whole drive."""
    cells, costs = spread_cells(finder, config.spacing_m, rng)
    if len(cells) < 2:
        raise DataError(
            f"every place {config.clearance_m:.2f} m from obstacles lies within "
            f"{config.spacing_m} m of one of them: expected a smaller robot, a smaller spacing or "
            "more room",
            code="no-tour",
        )
    share = 1 - config.again - config.back
    most = np.inf if config.length_m is None else share * config.length_m
    # A tour of limited length reaches more way-points from some starts than from others.
    starts = rng.permutation(len(cells))[: 1 if np.isinf(most) else _STARTS]
    tour = max((round_trip(costs, most, int(start)) for start in starts), key=len)
    return cells[tour], config.length_m or tour_cost(tour, costs) / share


def _legs(
    finder: RouteFinder,
    tour: Integers,
    length_m: float,
    config: PlanConfig,
    rng: np.random.Generator,
) -> list[Floats]:
    """Paths from each way-point to the next, (N, 2) each; together longer than the drive."""
    legs: list[Floats] = []
    phases = _phases(config, length_m)
    direction, end_m = next(phases)
    place, here, total = 0, int(tour[0]), 0.0
    while total < _RESERVE * length_m:
        while total >= end_m:
            direction, end_m = next(phases)
        place = (place + direction) % len(tour)
        there = _nearby(finder, int(tour[place]), config.wander_m, rng)
        if there == here:
            continue
        chain = finder.way(here, there)
        legs.append(np.stack([finder.x[chain], finder.y[chain]], axis=1))
        here, total = there, total + float(lengths(legs[-1])[-1])
    return legs


def _phases(config: PlanConfig, length_m: float) -> Iterator[tuple[int, float]]:
    """Endless sequence of directions round the tour and the driven length at which each ends."""
    first = 1 - config.again - config.back
    end_m = 0.0
    for direction, share in cycle([(1, first), (1, config.again), (-1, config.back)]):
        end_m += share * length_m
        yield direction, end_m


def _nearby(finder: RouteFinder, cell: int, apart_m: float, rng: np.random.Generator) -> int:
    """A random reachable cell within ``apart_m`` of one, so that no two passes are identical."""
    radius, angle = apart_m * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)
    x = float(finder.x[cell] + radius * np.cos(angle))
    y = float(finder.y[cell] + radius * np.sin(angle))
    return finder.cell((x, y)) if finder.room.is_free(x, y) else cell


def _join_legs(legs: list[Floats]) -> list[Floats]:
    """Join consecutive legs unless the path turns sharply between them."""
    paths = [legs[0]]
    for leg in legs[1:]:
        came, goes = -_heading(paths[-1][::-1]), _heading(leg)
        if came @ goes < np.cos(_SHARP_RAD) * np.linalg.norm(came) * np.linalg.norm(goes):
            paths.append(leg)
        else:
            paths[-1] = np.concatenate([paths[-1], leg[1:]])
    return paths


def _heading(path: Floats) -> Floats:
    """Vector from the first point of a path to the one ``_LOOK_M`` further on, (2,)."""
    along = lengths(path)
    ahead: Floats = path[min(int(np.searchsorted(along, _LOOK_M)), len(along) - 1)] - path[0]
    return ahead


def _shorten_paths(paths: list[Floats], length_m: float) -> list[Floats]:
    """The first ``length_m`` metres of consecutive paths."""
    kept = []
    for path in paths:
        along = lengths(path)
        inside = path[along <= length_m]
        if len(inside) > 1:
            kept.append(inside)
        length_m -= float(along[-1])
        if length_m <= 0:
            break
    return kept
