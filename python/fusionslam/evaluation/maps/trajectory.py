# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of trajectories in space."""

import numpy as np

from fusionslam.argument_types import checked
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.rigid import fit_motion
from fusionslam.storage.arrays import Floats, Integers, read_numbers


@checked
def trajectory_error(poses: Floats, truth: Floats, parts: Integers | None = None) -> float:
    """Absolute trajectory error (ATE): root mean square of the distances to the true positions.

    Args:
        poses: float64 (n, 4, 4), n > 0.
        truth: float64 (n, 4, 4), at the same times; rows with NaN are left out.
        parts: int64 (n): poses of one number are aligned by one rigid motion; None for all.

    Returns:
        Metres, after the alignment; NaN if no true pose is known.

    Raises:
        ShapeError: other shapes, or no poses.
        DataError: a pose is not finite (code "not-finite").
    """
    poses = read_numbers("poses", poses, "(n, 4, 4)")
    truth = read_numbers("truth", truth, "(n, 4, 4)")
    shape = (len(poses) if poses.ndim else 0, 4, 4)
    if not shape[0] or not poses.shape == truth.shape == shape:
        raise ShapeError(
            f"poses and truth have shapes {poses.shape} and {truth.shape}, "
            "expected (n, 4, 4), n > 0"
        )
    if parts is not None and np.shape(parts) != shape[:1]:
        raise ShapeError(f"parts has shape {np.shape(parts)}, expected {shape[:1]}")
    if not np.isfinite(poses).all():
        raise DataError("poses holds NaN or infinity, expected numbers", code="not-finite")
    known = np.isfinite(truth).all(axis=(1, 2))
    numbers = np.zeros(len(poses), np.int64) if parts is None else parts
    squares = []
    for part in np.unique(numbers[known]):
        rows = known & (numbers == part)
        aligned = fit_motion(poses[rows], truth[rows]) @ poses[rows]
        squares.append(((aligned - truth[rows])[:, :3, 3] ** 2).sum(axis=1))
    return float(np.sqrt(np.concatenate(squares).mean())) if squares else float("nan")
