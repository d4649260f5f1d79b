# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds that tests of fusion and descriptors share."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusionslam.sensors.frame import Cloud
from project import SMALL_DATA

Points = NDArray[np.float32]
Colors = NDArray[np.uint8]


def read_scan(path: Path) -> Points:
    return np.fromfile(path, np.float32).reshape(-1, 4)[:, :3].copy()


MADE = SMALL_DATA / "made"


def load_made(name: str) -> tuple[Points, Colors]:
    """A cloud of the simulator that is stored with the tests; black where it has no colours."""
    with np.load(MADE / "clouds.npz") as clouds:
        points = clouds[f"{name}_xyz"]
        colors = clouds.get(f"{name}_rgb")
    return points, np.zeros(points.shape, np.uint8) if colors is None else colors


def street(seed: int, count: int = 4000) -> tuple[Points, Colors]:
    """A coloured synthetic cloud: ground, two unlike house fronts and some poles."""
    rng = np.random.default_rng(seed)
    ground = rng.uniform([-30, -6, -0.05], [45, 8, 0.05], (count // 2, 3))
    left = rng.uniform([-25, 7.9, 0], [20, 8.1, 7], (count // 4, 3))
    right = rng.uniform([-5, -6.1, 0], [40, -5.9, 4], (count // 8, 3))
    feet = rng.uniform([-30, -5, 0], [45, 7, 0], (count // 80, 3))
    poles = np.repeat(feet, 10, axis=0)
    poles[:, 2] = rng.uniform(0, 5, len(poles))
    points = np.concatenate([ground, left, right, poles]).astype(np.float32)
    shades = rng.integers(0, 256, (4, 3))
    sizes = [len(ground), len(left), len(right), len(poles)]
    colors = np.repeat(shades, sizes, axis=0) + rng.integers(-20, 21, (len(points), 3))
    return points, np.clip(colors, 0, 255).astype(np.uint8)


def scan_blocks(pose: ArrayLike, seed: int, count: int = 30000, *, place: int = 12) -> Points:
    """Points of a made place, 120 m wide, in the frame of a sensor: ground, houses, poles.

    Args:
        pose: float64 (4, 4), world_from_sensor; points up to 30 m away are seen, through walls.
        seed: of the points on the surfaces, which are the same for every seed.
        place: another number is another place.
    """
    world, rng = np.random.default_rng(place), np.random.default_rng(seed)
    middles = world.uniform(-60, 60, (60, 2))
    sizes = world.uniform([2, 2, 1], [12, 12, 9], (60, 3))
    sizes[::3, :2] = 0.4  # poles
    areas = (sizes[:, 0] + sizes[:, 1]) * sizes[:, 2]
    box = rng.choice(60, count, p=areas / areas.sum())
    side = rng.integers(0, 4, count)
    at = rng.uniform(-0.5, 0.5, (count, 3))
    at[side < 2, 0] = np.where(side[side < 2] == 0, -0.5, 0.5)
    at[side >= 2, 1] = np.where(side[side >= 2] == 2, -0.5, 0.5)
    walls = np.c_[middles[box], sizes[box, 2] / 2] + at * sizes[box]
    ground = rng.uniform([-60, -60, 0], [60, 60, 0], (count // 2, 3))
    points = np.concatenate([walls, ground]) + rng.normal(0, 0.01, (count + count // 2, 3))
    sensor_from_world = np.linalg.inv(np.asarray(pose, np.float64))
    seen = points @ sensor_from_world[:3, :3].T + sensor_from_world[:3, 3]
    near: Points = seen[np.linalg.norm(seen, axis=1) < 30].astype(np.float32)
    return near


def painted_blocks(pose: ArrayLike, seed: int, palette: int = 0) -> Cloud:
    """``scan_blocks`` with colours that change every 4 m of the world."""
    points, world_from_sensor = scan_blocks(pose, seed), np.asarray(pose, np.float64)
    world = points @ world_from_sensor[:3, :3].T + world_from_sensor[:3, 3]
    colors = np.random.default_rng(palette).integers(0, 256, (30, 30, 30, 3), dtype=np.uint8)
    return Cloud(points, colors[tuple((np.floor(world / 4).astype(int) % 30).T)])


def polar_cloud(
    rng: np.random.Generator, sectors: int, rings: int, max_range: float, count: int = 2000
) -> Points:
    """Points whose azimuth and range keep away from the borders of bins."""
    turn = (rng.integers(0, sectors, count) + rng.uniform(0.1, 0.9, count)) / sectors
    reach = (rng.integers(0, rings, count) + rng.uniform(0.1, 0.9, count)) * max_range / rings
    azimuth = 2 * np.pi * turn
    height = rng.uniform(-1.5, 4.5, count)
    points = np.stack([reach * np.cos(azimuth), reach * np.sin(azimuth), height], axis=1)
    return points.astype(np.float32)


def cells_cloud(seed: int, cell: float, reach: int, heights: ArrayLike) -> Points:
    """300 points in cells up to ``reach`` from the origin, away from borders, about heights."""
    rng = np.random.default_rng(seed)
    places = rng.integers(-reach, reach, (300, 2)) + rng.uniform(0.2, 0.8, (300, 2))
    tops = rng.choice(np.asarray(heights), 300) + rng.uniform(-0.2, 0.2, 300)
    return np.column_stack([cell * places, tops]).astype(np.float32)


def walls(seed: int) -> Points:
    """Dense points of forty walls within 45 m, each as high as its top."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(-30, 30, (40, 1, 2)) + rng.uniform(-8, 8, (40, 2, 2))
    along = np.linspace(0, 1, 200)[:, None]
    flat = np.concatenate([(1 - along) * start + along * end for start, end in ends])
    tops = np.repeat(rng.uniform(-1.2, 5, 40), 200)
    return np.column_stack([flat, tops]).astype(np.float32)


def seen_after_turn(points: NDArray[np.floating], yaw: float) -> Points:
    """The cloud in the frame of a robot that has turned left by ``yaw`` radians."""
    c, s = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    turned: Points = (points.astype(np.float64) @ rotation).astype(np.float32)
    return turned


def distance(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    return float(np.linalg.norm(a.astype(np.float64) - b.astype(np.float64)))


def cie_lab(colors: NDArray[np.uint8]) -> NDArray[np.float64]:
    """L, a, b of IEC 61966-2-1 and CIE 1976 with white D65, a row for each colour."""
    encoded = colors / 255
    linear = np.where(encoded > 0.04045, ((encoded + 0.055) / 1.055) ** 2.4, encoded / 12.92)
    xyz_from_rgb = [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
    ratio = linear @ np.transpose(xyz_from_rgb) / [0.95047, 1, 1.08883]
    x, y, z = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio * (29 / 6) ** 2 / 3 + 4 / 29).T
    return np.column_stack([116 * y - 16, 500 * (x - y), 200 * (y - z)])


PROJECTION = np.array([[300.0, 0, 160, 12], [0, 310, 120, 3], [0, 0, 1, 0.05]])


def scene(seed: int, count: int = 5000) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Points all around the camera, half of them behind it, and an image."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-30, -12, -40], [30, 12, 40], (count, 3)).astype(np.float32)
    return points, rng.integers(0, 256, (240, 320, 3), dtype=np.uint8)


def homogeneous(rotation: NDArray[np.float64], shift: ArrayLike = (0, 0, 0)) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.reshape(3, 3), shift
    return matrix


def ground_and_things(seed: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """A rough, slightly sloping floor at z = -1.7 and things on it; which points are floor."""
    rng = np.random.default_rng(seed)
    floor = rng.uniform([-30, -30, -0.05], [30, 30, 0.05], (3000, 3))
    floor[:, 2] += -1.7 + 0.02 * floor[:, 0]
    things = rng.uniform([-30, -30, -0.5], [30, 30, 4], (2000, 3))
    things[:, 2] += 0.02 * things[:, 0]
    return np.concatenate([floor, things]), np.arange(5000) < 3000


def make_room(count: int = 3000, sides: int = 4) -> Points:
    """Points on the walls of a room of 8 m, with ``sides`` 6 on floor and ceiling, too."""
    rng = np.random.default_rng(3)
    walls = rng.uniform(-4, 4, (count, 3))
    rows = np.arange(count)
    walls[rows, rng.integers(0, sides // 2, count)] = rng.choice([-4.0, 4.0], count)
    return walls.astype(np.float32)
