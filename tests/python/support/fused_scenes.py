# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes and files that the tests of fusion share."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

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


def read_scan(path: Path) -> NDArray[np.float32]:
    return np.fromfile(path, np.float32).reshape(-1, 4)[:, :3].copy()


def ground_and_things(seed: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """A rough, slightly sloping floor at z = -1.7 and things on it; which points are floor."""
    rng = np.random.default_rng(seed)
    floor = rng.uniform([-30, -30, -0.05], [30, 30, 0.05], (3000, 3))
    floor[:, 2] += -1.7 + 0.02 * floor[:, 0]
    things = rng.uniform([-30, -30, -0.5], [30, 30, 4], (2000, 3))
    things[:, 2] += 0.02 * things[:, 0]
    return np.concatenate([floor, things]), np.arange(5000) < 3000
