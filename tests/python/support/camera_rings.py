# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras all round a scanner, and what they see of a coloured world around it."""

import numpy as np
from numpy.typing import NDArray

from fusionslam import Camera

Matrix = NDArray[np.float64]
SIZE = (80, 60)
FOCAL = 33.0
"""Half the width of the image over it is the tangent of 50.5 degrees."""
RING = {"left": 0.0, "side_left": 90.0, "rear": 180.0, "side_right": -90.0}
"""Yaw of each camera, degrees."""
_OPTICAL = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])


def camera_at(yaw_deg: float, size: tuple[int, int] = SIZE) -> Camera:
    """A camera at the scanner, turned to the left by an angle."""
    c, s = np.cos(np.deg2rad(yaw_deg)), np.sin(np.deg2rad(yaw_deg))
    turn = np.eye(4)
    turn[:2, :2] = [[c, s], [-s, c]]
    width, height = size
    focal = FOCAL * width / SIZE[0]
    projection = np.array(
        [[focal, 0, (width - 1) / 2, 0], [0, focal, (height - 1) / 2, 0], [0, 0, 1, 0]]
    )
    return Camera(projection, _OPTICAL @ turn, size)


def ring() -> dict[str, Camera]:
    return {name: camera_at(yaw) for name, yaw in RING.items()}


def points_around(count: int = 20_000, seed: int = 4) -> NDArray[np.float32]:
    """Points on a cylinder around the scanner, 5 m away."""
    rng = np.random.default_rng(seed)
    angle, z = rng.uniform(-np.pi, np.pi, count), rng.uniform(-2, 2, count)
    return np.stack([5 * np.cos(angle), 5 * np.sin(angle), z], axis=1).astype(np.float32)


def world_colors(points: NDArray[np.floating]) -> Matrix:
    """Smooth colours of directions, 60 to 120: float64 (N, 3)."""
    angle = np.arctan2(points[:, 1], points[:, 0])
    waves = [np.sin(k * angle + k * k) for k in (1, 2, 3)]
    return 90 + 30 * np.stack(waves, axis=1)


def picture(camera: Camera, gain: NDArray[np.float64] | float = 1.0) -> NDArray[np.uint8]:
    """What a camera sees of the world, times gains of red, green and blue."""
    assert camera.size is not None
    width, height = camera.size
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    rays = np.linalg.inv(camera.projection[:, :3]) @ np.stack([u, v, np.ones_like(u)]).reshape(
        3, -1
    )
    directions = camera.points_from_rectified[:3, :3] @ rays
    seen = world_colors(directions.T) * gain
    return np.rint(seen).clip(0, 255).astype(np.uint8).reshape(height, width, 3)
