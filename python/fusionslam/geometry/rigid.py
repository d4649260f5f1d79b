# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Rigid motions: the one that aligns planar poses to others, and checks of 4x4 matrices."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fusionslam.base.arrays import Floats, read_numbers
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.se2 import wrapped

_ROTATION_TOLERANCE = 1e-2  # of matrices that were written as text with three digits
_FARTHEST_MOUNTED_M = 100.0


def is_rigid(matrix: Floats, tolerance: float = _ROTATION_TOLERANCE) -> bool:
    """Whether a float64 (4, 4) matrix is a finite rotation and translation.

    Args:
        matrix: the matrix.
        tolerance: most that an entry of R R^T may differ from the identity.
    """
    if not np.isfinite(matrix).all() or not np.array_equal(matrix[3], [0, 0, 0, 1]):
        return False
    turn = matrix[:3, :3]
    return bool(np.abs(turn @ turn.T - np.eye(3)).max() <= tolerance and np.linalg.det(turn) > 0)


def check_mounting(name: str, matrix: Floats) -> None:
    """Check the pose of one sensor relative to another on the same robot.

    Args:
        name: of the matrix, for the error.
        matrix: float64 (4, 4), finite.

    Raises:
        DataError: it is no rotation and translation (code "not-a-rotation"), or of more than
            100 m (code "not-metres").
    """
    if not is_rigid(matrix):
        cure = "; its transpose is one: write it row by row" if is_rigid(matrix.T) else ""
        raise DataError(
            f"{name} is no rotation and translation{cure}: {matrix.tolist()}",
            code="not-a-rotation",
            fields=(name,),
        )
    if (away := float(np.linalg.norm(matrix[:3, 3]))) > _FARTHEST_MOUNTED_M:
        raise DataError(
            f"{name} moves points by {away:.0f} m, farther than on any robot: expected metres",
            code="not-metres",
            fields=(name, f"{away:.0f}"),
        )


class RigidMotion(NamedTuple):
    """A rigid motion of the plane: a rotation about the origin, then a translation.

    Attributes:
        x, y: translation in metres.
        turn: rotation in radians, counter-clockwise.
    """

    x: float
    y: float
    turn: float

    def apply(self, poses: Floats) -> Floats:
        """Transform poses, headings too: float64 (n, 3), x, y in metres and heading in radians."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        x = c * poses[:, 0] - s * poses[:, 1] + self.x
        y = s * poses[:, 0] + c * poses[:, 1] + self.y
        return np.stack([x, y, wrapped(poses[:, 2] + self.turn)], axis=1)


def fit_rigid(poses: Floats, truth: Floats) -> RigidMotion:
    """Fit the rigid motion that aligns positions to the true ones in least squares.

    Headings are ignored unless the positions do not determine the rotation, as when all
    coincide; it is then the mean difference of the headings.

    Args:
        poses, truth: float64 (n, 3), n > 0, x, y in metres and heading in radians; equal rows
            belong to the same time.

    Raises:
        ShapeError: these are no numbers, the shapes are wrong or differ, or there are no poses.
        DataError: a value is not finite.

    Source: Kabsch 1976, in two dimensions.
    """
    poses, truth = _check("poses", poses), _check("truth", truth)
    if poses.shape != truth.shape or not len(poses):
        raise ShapeError(
            f"poses {poses.shape} and truth {truth.shape}: expected both (n, 3), n > 0"
        )
    here, there = poses[:, :2].mean(axis=0), truth[:, :2].mean(axis=0)
    spread = (poses[:, :2] - here).T @ (truth[:, :2] - there)
    sine, cosine = spread[0, 1] - spread[1, 0], spread[0, 0] + spread[1, 1]
    extent = np.abs(poses[:, :2] - here).max() * np.abs(truth[:, :2] - there).max()
    if np.hypot(sine, cosine) <= 1e-12 * len(poses) * extent:
        turns = truth[:, 2] - poses[:, 2]
        sine, cosine = np.sin(turns).sum(), np.cos(turns).sum()
    turn = float(np.arctan2(sine, cosine))
    c, s = np.cos(turn), np.sin(turn)
    x, y = there - np.array([c * here[0] - s * here[1], s * here[0] + c * here[1]])
    return RigidMotion(float(x), float(y), turn)


def fit_motion(poses: Floats, truth: Floats) -> Floats:
    """Fit the rigid motion in space, (4, 4), that aligns positions to true ones in least squares.

    Args:
        poses, truth: float64 (n, 4, 4), n > 0; equal rows belong to the same time.

    Source: Kabsch 1976.
    """
    here, there = poses[:, :3, 3], truth[:, :3, 3]
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    motion = np.eye(4)
    motion[:3, :3] = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    motion[:3, 3] = there.mean(axis=0) - motion[:3, :3] @ here.mean(axis=0)
    return motion


def _check(name: str, values: Floats) -> Floats:
    rows = read_numbers(name, values, "(n, 3)")
    if rows.shape[1:] != (3,):
        raise ShapeError(f"{name} {rows.shape}: expected (n, 3), n > 0")
    broken = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if broken.size:
        raise DataError(f"{name}: row {broken[0]} is {rows[broken[0]].tolist()}, expected numbers")
    return rows


def rotation(angles: Sequence[float]) -> Floats:
    """Rotation matrix (3, 3) of roll, pitch, yaw in radians: about x first, then y, then z."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    turned: Floats = about_z @ about_y @ about_x
    return turned
