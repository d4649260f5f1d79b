# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Coloured scans of made rooms, worked out ray by ray: upright walls of some height."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.sensors.frame import Cloud

Array = NDArray[np.float64]
Pose = tuple[float, float, float]

SENSOR_M = 0.17
AHEAD = np.radians(np.arange(-60.0, 60.0, 1.0))
BEHIND = AHEAD + np.pi
AROUND = np.radians(np.arange(0.0, 360.0, 1.0))
ELEVATIONS = np.radians(np.arange(-7.0, 30.0, 2.0))


@dataclass(frozen=True)
class Room:
    """Walls from ``first`` (w, 2) to ``last`` (w, 2) in metres, as high as ``height`` (w), of
    colour (w, 3)."""

    first: Array
    last: Array
    height: Array
    color: NDArray[np.uint8]


def room(seed: int, half: tuple[float, float] = (4.0, 3.0), boxes: int = 9) -> Room:
    """A rectangle with boxes along its walls, at least 1.5 m from the middle."""
    rng = np.random.default_rng([29, seed])
    rectangles = [(np.zeros(2), np.array(half), 2.5, rng.integers(0, 256, 3))]
    while len(rectangles) <= boxes:
        center = rng.uniform(-1, 1, 2) * half
        if np.hypot(*center) > 1.5:
            size, height = rng.uniform(0.15, 0.5, 2), rng.uniform(0.4, 2.0)
            rectangles.append((center, size, height, rng.integers(0, 256, 3)))
    around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corners = np.concatenate([center + around * size for center, size, _, _ in rectangles])
    after = np.concatenate([center + np.roll(around, -1, 0) * s for center, s, _, _ in rectangles])
    heights = np.repeat([height for *_, height, _ in rectangles], 4)
    colors = np.repeat([color for *_, color in rectangles], 4, axis=0)
    return Room(corners, after, heights, colors.astype(np.uint8))


def scan(
    where: Room, pose: Pose, azimuths: Array = AHEAD, *, seed: int = 0, noise_m: float = 0.005
) -> Cloud:
    """What a robot at x, y, yaw sees of a room: a cloud in its frame, the floor not in it."""
    azimuth, elevation = (part.ravel() for part in np.meshgrid(azimuths, ELEVATIONS))
    level, wall = _nearest(where, pose, azimuth, np.tan(elevation))
    seen = np.isfinite(level)
    azimuth, elevation = azimuth[seen], elevation[seen]
    noise = np.random.default_rng([31, seed]).normal(0, noise_m, len(azimuth))
    level = level[seen] + noise * np.cos(elevation)
    place = [level * np.cos(azimuth), level * np.sin(azimuth)]
    points = np.stack([*place, SENSOR_M + level * np.tan(elevation)], axis=1)
    return Cloud(points.astype(np.float32), where.color[wall[seen]])


def _nearest(
    where: Room, pose: Pose, azimuth: Array, slope: Array
) -> tuple[Array, NDArray[np.int64]]:
    """How far in plan the first wall of each ray is, infinite for none, and which it is."""
    x, y, yaw = pose
    ray = np.stack([np.cos(azimuth + yaw), np.sin(azimuth + yaw)], axis=1)[:, None]
    along = (where.last - where.first)[None]
    to_wall = (where.first - [x, y])[None]

    def cross(a: Array, b: Array) -> Array:
        return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], np.float64)

    with np.errstate(divide="ignore", invalid="ignore"):
        far = cross(to_wall, along) / cross(ray, along)
        share = cross(to_wall, ray) / cross(ray, along)
        height = SENSOR_M + far * slope[:, None]
        met = (far > 0) & (share >= 0) & (share <= 1) & (height > 0.1) & (height <= where.height)
    far = np.where(met, far, np.inf)
    return far.min(axis=1), far.argmin(axis=1)


def seen_from(stored: Pose, current: Pose) -> Pose:
    """The current pose in the frame of the stored one."""
    dx, dy = current[0] - stored[0], current[1] - stored[1]
    c, s = np.cos(stored[2]), np.sin(stored[2])
    return float(c * dx + s * dy), float(c * dy - s * dx), current[2] - stored[2]
