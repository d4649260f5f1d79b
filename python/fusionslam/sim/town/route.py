# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The car's route: laps over street crossings, on the right-hand side, with rounded corners.

The car's frame is x forward, y left, z up, on the street below the LiDAR.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from fusionslam.base.arrays import Floats
from fusionslam.config import Section, option
from fusionslam.geometry.rigid import rotation
from fusionslam.sim.motion.smoothing import interpolate_path, lengths, resample_path

Crossing = tuple[int, int]

_STEP_M = 0.1
_BLEND_M = 14.0
_CORNER_M = 8.0
_LANE_M = 2.3
"""From the centre line to the middle of other cars: as far right as parked ones let them."""
_LOOP: tuple[Crossing, ...] = ((1, 0), (2, 0), (2, 1), (1, 1), (0, 1), (0, 0), (1, 0))
_AGAIN: tuple[Crossing, ...] = ((1, 0), (2, 0), (2, 1), (1, 1))
_BACK: tuple[Crossing, ...] = ((1, 1), (1, 0), (0, 0), (0, 1), (1, 1))


class DriveConfig(Section):
    """The route and how it is driven. Default: a loop, half of it again, the rest backwards."""

    laps: tuple[tuple[Crossing, ...], ...] = option(
        (_LOOP, _AGAIN, _BACK),
        "crossings (column, row) passed on each lap; a lap starts where the one before ends",
        min_length=1,
    )
    spacing_m: float = option(2.0, "distance between frames", unit="m", gt=0, le=50)
    speed_m_s: float = option(8.0, "speed, constant", unit="m/s", gt=0)
    lane_m: float = option(1.75, "distance to the right of the centre line", unit="m", ge=0, le=3)
    lap_shift_m: tuple[float, ...] = option(
        (0.0, -1.2, 0.2),
        "further distance to the right on each lap (the last value serves later laps)",
        unit="m",
        min_length=1,
    )
    corner_radius_m: float = option(
        8.0, "radius of the centre line in corners", unit="m", ge=4, le=18
    )
    wander_m: float = option(
        0.15, "standard deviation of a slow drift across the lane", unit="m", ge=0, le=1
    )
    wobble_deg: float = option(
        0.5,
        "standard deviation of the car's roll, pitch and yaw on its springs",
        unit="deg",
        ge=0,
        le=5,
    )

    @model_validator(mode="after")
    def _laps_can_be_driven(self) -> "DriveConfig":
        for number, (before, after) in enumerate(pairwise(self.laps), start=1):
            if after[0] != before[-1]:
                raise ValueError(
                    f"lap {number} starts at {after[0]}, the last ended at {before[-1]}"
                )
        route = self.crossings()
        if len(route) < 2:
            raise ValueError("the laps need at least two crossings")
        for a, b in pairwise(route):
            if abs(a[0] - b[0]) + abs(a[1] - b[1]) != 1:
                raise ValueError(f"no street joins crossings {a} and {b}")
        for a, b in zip(route, route[2:], strict=False):
            if a == b:
                raise ValueError(f"the car cannot turn back to {a}")
        return self

    def crossings(self) -> list[Crossing]:
        """All crossings in the order passed; the crossing shared by two laps appears once."""
        return [*self.laps[0], *(crossing for lap in self.laps[1:] for crossing in lap[1:])]


@dataclass(frozen=True)
class Drive:
    """N poses of the car along its route.

    Attributes:
        poses: float64 (N, 4, 4), world_from_car.
        seconds: float64 (N,), times from 0.
        lap: int64 (N,), number of the lap, from 0.
    """

    poses: Floats
    seconds: Floats
    lap: NDArray[np.int64]


def make_drive(config: DriveConfig, block_m: float, seed: int) -> Drive:
    """Drive the laps over streets ``block_m`` apart; ``seed`` decides drift and wobble."""
    rng = np.random.default_rng([seed, 0xD21])
    middle, lap = _middle_line(config, block_m)
    path = _in_lane(config, middle, lap, rng)
    length = lengths(path)
    stops = np.arange(0.0, length[-1], config.spacing_m)
    yaw = np.interp(stops, length, np.unwrap(_heading(path)))
    poses = _poses(interpolate_path(stops, length, path), yaw, stops, config, rng)
    laps = lap[np.searchsorted(length, stops).clip(max=len(lap) - 1)]
    return Drive(poses, stops / config.speed_m_s, laps)


def lanes_around_blocks(blocks: tuple[int, int], block_m: float) -> list[Floats]:
    """Lanes of other cars: round each block of a town, in both directions, (N, 2) each, closed."""
    lanes = []
    for column, row in np.ndindex(blocks):
        corners = block_m * np.add((column, row), [(0, 0), (1, 0), (1, 1), (0, 1)])
        for nodes in (corners, corners[::-1]):
            ways = zip(np.roll(nodes, 1, axis=0), nodes, np.roll(nodes, -1, axis=0), strict=True)
            line = np.concatenate([_arc(*way, _CORNER_M) for way in ways])
            line = resample_path(np.concatenate([line, line[:1]]), _STEP_M)[:-1]
            ahead = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
            ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
            lanes.append(line + _LANE_M * ahead[:, ::-1] * (1, -1))
    return lanes


def _middle_line(config: DriveConfig, block_m: float) -> tuple[Floats, NDArray[np.int64]]:
    """Points on the streets' centre lines at equal steps, (K, 2), and the lap of each."""
    nodes = np.asarray(config.crossings(), np.float64) * block_m
    corners = zip(nodes, nodes[1:], nodes[2:], strict=False)
    arcs = [_arc(*corner, config.corner_radius_m) for corner in corners]
    pieces = [nodes[:1], *arcs, nodes[-1:]]
    line = np.concatenate(pieces)
    length = lengths(line)
    steps = np.arange(0.0, length[-1], _STEP_M)
    ends = np.cumsum([len(lap) - 1 for lap in config.laps])[:-1]
    firsts = np.cumsum([len(piece) for piece in pieces])[:-1]
    starts = length[firsts[ends - 1]]
    points = interpolate_path(steps, length, line)
    return points, np.searchsorted(starts, steps, side="right")


def _arc(before: Floats, node: Floats, after: Floats, radius: float) -> Floats:
    """Points past an inner node: the node itself, or an arc where the route turns."""
    into = (node - before) / np.linalg.norm(node - before)
    out = (after - node) / np.linalg.norm(after - node)
    if into @ out > 0.99:
        return node[None]
    angle = np.linspace(0, np.pi / 2, 65)[:, None]
    centre = node + radius * (out - into)
    arc: Floats = centre - radius * np.cos(angle) * out + radius * np.sin(angle) * into
    return arc


def _in_lane(
    config: DriveConfig, middle: Floats, lap: NDArray[np.int64], rng: np.random.Generator
) -> Floats:
    """The centre line shifted to the right by lane, lap and drift, (K, 2)."""
    shifts = np.asarray(config.lap_shift_m)
    aside = config.lane_m + shifts[lap.clip(max=len(shifts) - 1)]
    drift = _drift(rng, _STEP_M * np.arange(len(middle), dtype=np.float64))
    aside = _moving_average(aside) + config.wander_m * drift
    heading = _heading(middle)
    right = np.stack([np.sin(heading), -np.cos(heading)], axis=1)
    moved: Floats = middle + aside[:, None] * right
    return moved


def _moving_average(values: Floats) -> Floats:
    """Moving average over _BLEND_M, with the end values repeated."""
    half = round(_BLEND_M / _STEP_M / 2)
    padded = np.pad(values, half, mode="edge")
    window = 2 * half + 1
    total = np.concatenate([[0.0], np.cumsum(padded)])
    smooth: Floats = (total[window:] - total[:-window]) / window
    return smooth


def _drift(rng: np.random.Generator, along: Floats) -> Floats:
    """A smooth random function of path length, deviation about 1: four waves of 12 to 70 m."""
    waves = rng.uniform(12.0, 70.0, 4)
    phases = rng.uniform(0, 2 * np.pi, 4)
    mixed: Floats = np.sin(2 * np.pi * along[:, None] / waves + phases).sum(axis=1) / np.sqrt(2.0)
    return mixed


def _poses(
    where: Floats, yaw: Floats, along: Floats, config: DriveConfig, rng: np.random.Generator
) -> Floats:
    wobble = np.deg2rad(config.wobble_deg)
    roll, pitch, turn = (wobble * _drift(rng, along) for _ in range(3))
    poses = np.tile(np.eye(4), (len(where), 1, 1))
    poses[:, :3, :3] = [
        rotation(angles) for angles in zip(roll, pitch, yaw + 0.5 * turn, strict=True)
    ]
    poses[:, :2, 3] = where
    return poses


def _heading(line: Floats) -> Floats:
    slope = np.gradient(line, axis=0)
    return np.arctan2(slope[:, 1], slope[:, 0])
