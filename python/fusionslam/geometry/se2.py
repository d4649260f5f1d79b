# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Poses in the plane: x, y in metres and heading in radians, counter-clockwise."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats

Pose = Sequence[float] | Floats
"""x, y and heading."""

_UPRIGHT = np.cos(np.radians(30))


def places_of(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """float64 (n, 3): x, y and yaw of poses (n, 4, 4) of a body whose z axis points up.

    A world whose z axis does not point up, such as KITTI's, is rotated first so that it does.
    """
    up = poses[:, :3, 2].mean(axis=0)
    up /= np.linalg.norm(up)
    turned = poses
    if up[2] <= _UPRIGHT:
        x = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
        x /= np.linalg.norm(x)
        turned = np.stack([x, np.cross(up, x), up]) @ poses[:, :3]
    yaw = np.arctan2(turned[:, 1, 0], turned[:, 0, 0])
    return np.stack([turned[:, 0, 3], turned[:, 1, 3], yaw], axis=1)


def compose(poses: Floats, offsets: Floats) -> Floats:
    """Compose poses with offsets that are given in the frames of the poses.

    Args:
        poses, offsets: float64 (n, 3), x, y in metres and heading in radians.

    Returns:
        float64 (n, 3), headings in (-pi, pi].
    """
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, 0] + c * offsets[:, 0] - s * offsets[:, 1]
    y = poses[:, 1] + s * offsets[:, 0] + c * offsets[:, 1]
    return np.stack([x, y, wrapped(poses[:, 2] + offsets[:, 2])], axis=1)


def relative_to(frame: Pose, pose: Pose) -> tuple[float, float, float]:
    """A pose in the frame of another one: x, y in metres and heading in radians, in (-pi, pi]."""
    c, s = math.cos(frame[2]), math.sin(frame[2])
    dx, dy = pose[0] - frame[0], pose[1] - frame[1]
    return c * dx + s * dy, c * dy - s * dx, wrap(pose[2] - frame[2])


def find_near(poses: Floats, pose: Pose, metres: float, radians: float) -> NDArray[np.bool_]:
    """Find the poses, float64 (n, 3), that are within metres and radians of one: bool (n,)."""
    apart = poses - np.asarray(pose)
    near = np.hypot(apart[:, 0], apart[:, 1]) < metres
    return np.asarray(near & (np.abs(wrapped(apart[:, 2])) < radians))


def transform_points(points: NDArray[Any], x: float, y: float, yaw: float) -> Floats:
    """Transform points from the body frame of a planar pose to its parent frame: float64 (N, 3)."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    moved = np.einsum("ij,kj->ik", points.astype(np.float64), turn) + np.array([x, y, 0])
    return np.asarray(moved)


def wrap(angle: float) -> float:
    """Wrap an angle, radians, to (-pi, pi]."""
    return float(wrapped(np.asarray(angle)))


def wrapped(angles: Floats) -> Floats:
    """Wrap angles, radians, to (-pi, pi]."""
    return np.asarray(np.pi - (np.pi - angles) % (2 * np.pi))
