# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of drives, and runs over them that are judged."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from artefacts import artefact
from fusionslam.evaluation import ViewRule
from fusionslam.sim import DriveConfig, SimConfig, TownConfig, record

PLACES = 12
AZIMUTHS, ELEVATIONS = np.radians(np.linspace(-30, 30, 121)), np.radians(np.linspace(-8, 8, 9))


def write_drive(path: Path, *, laps: int = 2, empty: int = 0, step_s: float = 2.0) -> Path:
    """Two laps along x, 1 m from place to place; each place has three coloured things of its own.

    Args:
        path: of the file.
        laps: how often the places are passed.
        empty: scans at the end that see the floor only.
        step_s: from scan to scan.
    """
    places = np.tile(np.arange(PLACES), laps)
    scans = [_scan(place, seed) for seed, place in enumerate(places.tolist())]
    scans += [_floor()] * empty
    count = len(scans)
    x = np.append(places, np.full(empty, PLACES))
    np.savez(
        path,
        stamps=np.arange(count) * step_s,
        poses=np.stack([x * 1.0, np.zeros(count), np.zeros(count)], axis=1),
        rays=_rays(),
        lidar_xyz=np.array([0.0, 0.0, 0.3]),
        collision_ray=np.concatenate([rays for rays, _, _ in scans]).astype(np.uint16),
        collision_range_mm=np.concatenate([mm for _, mm, _ in scans]).astype(np.uint16),
        collision_rgb=np.concatenate([rgb for _, _, rgb in scans]),
        collision_offsets=np.cumsum([0, *(len(rays) for rays, _, _ in scans)]),
    )
    return path


def _rays() -> np.ndarray:
    azimuth, elevation = np.meshgrid(AZIMUTHS, ELEVATIONS)
    parts = (np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth))
    return np.stack([*parts, np.sin(elevation)], axis=-1).reshape(-1, 3)


def _scan(place: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays, millimetres and colours of three things, which the place decides, with some noise."""
    things, noise = np.random.default_rng([7, place]), np.random.default_rng([8, seed])
    rays, ranges, colors = [], [], []
    for start in (0, 40, 80):
        first, width = start + things.integers(0, 15), things.integers(10, 22)
        columns = np.arange(first, first + width)
        grid = (np.arange(5, 9)[:, None] * len(AZIMUTHS) + columns).ravel()
        metres = things.uniform(1.5, 5.0) + noise.normal(0, 0.005, len(grid))
        rays.append(grid)
        ranges.append(np.round(metres * 1000))
        colors.append(np.tile(things.integers(0, 256, 3), (len(grid), 1)))
    return np.concatenate(rays), np.concatenate(ranges), np.concatenate(colors).astype(np.uint8)


def _floor() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What hits the floor 2 m ahead."""
    rays = np.arange(50, 70)
    height = np.sin(ELEVATIONS[0])
    return rays, np.full(20, round(-0.28 / height * 1000)), np.full((20, 3), 90, np.uint8)


Drive = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]


def random_drive(seed: int, count: int, views: int) -> Drive:
    """Ids (some negative), poses on a coarse grid of a small room, and stamps with pauses."""
    rng = np.random.default_rng(seed)
    ids = rng.integers(-1, max(views, 1), count)
    grid = rng.integers(0, 6, (count, 2)) * 0.2
    yaw = np.radians(rng.integers(-40, 40, (count, 1)) * 6.0)
    stamps = np.cumsum(rng.choice([0.0, 0.5, 5.0, 20.0], count))
    return ids, np.hstack([grid, yaw]), stamps


def apart(one: NDArray[np.float64], other: NDArray[np.float64]) -> tuple[float, float]:
    """Metres and degrees between two poses."""
    turn = math.atan2(math.sin(one[2] - other[2]), math.cos(one[2] - other[2]))
    return math.dist(one[:2], other[:2]), abs(math.degrees(turn))


def judged_by_loops(drive: Drive, rule: ViewRule) -> dict[str, int]:
    """The counts that define a report."""
    ids, poses, stamps = drive
    first: dict[int, int] = {}
    names = ("false_positives", "false_negatives", "positives", "revisits", "found_revisits")
    counts = dict.fromkeys((*names, "loops", "correct_loops", "unplaced"), 0)
    for scan, view in enumerate(ids.tolist()):
        right = False
        counts["unplaced"] += view < 0
        if view in first:
            metres, degrees = apart(poses[scan], poses[first[view]])
            counts["positives"] += 1
            counts["false_positives"] += (
                metres > rule.false_positive_distance or degrees > rule.false_positive_angle
            )
            if stamps[scan] - stamps[first[view]] > rule.loop_age:
                right = metres <= rule.loop_distance and degrees <= rule.loop_angle
                counts["loops"] += 1
                counts["correct_loops"] += right
        else:
            near = [apart(poses[scan], poses[stored]) for stored in first.values()]
            counts["false_negatives"] += any(
                metres <= rule.false_negative_distance and degrees <= rule.false_negative_angle
                for metres, degrees in near
            )
            if view >= 0:
                first[view] = scan
        older = [
            apart(poses[scan], poses[j])
            for j in range(scan)
            if stamps[scan] - stamps[j] > rule.loop_age
        ]
        back = any(
            metres <= rule.revisit_distance and degrees <= rule.revisit_angle
            for metres, degrees in older
        )
        counts["revisits"] += back
        counts["found_revisits"] += back and right
    return counts | {"views": len(first)}


def scans_above_floor(
    test_data: Path, world: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses and stamps of a recording's scans that hold more than floor (z > 0.1 m)."""
    with np.load(test_data / "recordings" / f"{world}.npz") as data:
        heights = data["rays"][data["collision_ray"], 2] * (data["collision_range_mm"] / 1000)
        above = np.append(0, np.cumsum(heights + data["lidar_xyz"][2] > 0.1))
        kept = np.diff(above[data["collision_offsets"]]) > 0
        return data["poses"][kept], data["stamps"][kept]


def town_drive() -> Path:
    """A drive around one block of a town, whose rings are far apart on the road."""
    block = ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0))
    drive = DriveConfig(laps=(block,), lap_shift_m=(0.0,), spacing_m=20.0)
    config = SimConfig(town=TownConfig(seed=7, blocks=(1, 1)), drive=drive)
    return artefact("calibration-town", lambda folder: record(config, folder / "drive")) / "drive"
