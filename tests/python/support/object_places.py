# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Clouds of places with a few boxes each, seen on several visits, and drives through them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusionslam.sensors.frame import Cloud
from fusionslam.views.scene_set import CloudArray, SceneSet

NOTHING = Cloud(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))
POINTS = 80


def place(number: int, visit: int = 0, objects: int = 3, shift: float = 0.01) -> Cloud:
    """Boxes that stand apart; each visit sees other points of them, a little moved."""
    world = np.random.default_rng([7, number])
    seen = np.random.default_rng([11, number, visit])
    points, colors = [], []
    for index in range(objects):
        center = np.array([2 + 2.5 * index, *world.uniform(-2, 2, 1), 0.8])
        half = world.uniform(0.1, 0.4, 3)
        moved = center + seen.normal(0, shift, 3)
        points.append(moved + half * seen.uniform(-1, 1, (POINTS, 3)))
        colors.append(np.tile(world.integers(0, 256, 3), (POINTS, 1)))
    if not points:
        return NOTHING
    return Cloud(np.concatenate(points).astype(np.float32), np.concatenate(colors).astype(np.uint8))


def drive(places: Sequence[int], gap_s: float = 5.0, poses: bool = True) -> SceneSet:
    """One scan a place, places 5 m apart on a line; a negative one is a scan without points."""
    clouds, visits = [], dict.fromkeys(places, 0)
    for number in places:
        clouds.append(NOTHING if number < 0 else place(number, visits[number]))
        visits[number] += 1
    count = len(places)
    where = np.array([[5.0 * number, 0, 0] for number in places])
    return SceneSet(
        name="boxes",
        stamps_ns=(np.arange(count) * gap_s * 1e9).astype(np.int64),
        numbers=np.arange(count),
        empty=np.array(places) < 0,
        poses=where if poses else None,
        clouds=CloudArray.of(clouds),
    )


LAPS = (0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 4, 5, 2, 0)


def write_recording(path: Path, places: Sequence[int], poses: bool = True) -> NDArray[np.float32]:
    """The clouds of places, with floor, in the layout of .npz recordings; returns all points."""
    seen = drive(places)
    assert seen.clouds is not None
    floor = np.array([[1.0, 0, 0.05], [1.5, 0.2, 0.09]], np.float32)
    clouds = [np.concatenate([seen.clouds[i].points, floor]) for i in range(len(seen))]
    origin = np.array([-0.064, 0, 0.17])
    ways = np.concatenate(clouds) - origin
    millimetres = np.round(np.linalg.norm(ways, axis=1) * 1000)
    rays = ways / np.linalg.norm(ways, axis=1)[:, None]
    colors = [
        np.concatenate([seen.clouds[i].colors, np.full((2, 3), 90, np.uint8)])
        for i in range(len(seen))
    ]
    arrays = {
        "stamps": seen.seconds,
        "rays": rays,
        "lidar_xyz": origin,
        "visual_range_mm": millimetres.astype(np.uint16),
        "visual_ray": np.arange(len(rays), dtype=np.uint16),
        "visual_rgb": np.concatenate(colors),
        "visual_offsets": np.cumsum([0, *map(len, clouds)]),
    }
    if poses:
        arrays["poses"] = seen.true_poses()
    np.savez(path, **arrays)
    return np.asarray(rays * millimetres[:, None] / 1000 + origin, np.float32)
