# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Small recordings of ranges, as .npz: the same places passed twice."""

from pathlib import Path

import numpy as np

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
