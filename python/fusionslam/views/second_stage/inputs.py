# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Prepares clouds for the networks: normalisation, resampling, augmentation for training."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fusionslam.config import Section, option
from fusionslam.errors import DataError, ShapeError
from fusionslam.storage.arrays import Points

Normalisation = Literal["sphere", "robot"]


class AugmentConfig(Section):
    """Data augmentation in training (Qi et al. 2016, 4.1; point drop-out as in PointNet++)."""

    turn: bool = option(True, "turn about the axis that points up")
    jitter: float = option(0.01, "standard deviation of each coordinate, cut at 5 of it", ge=0)
    scale: float = option(0.2, "each axis is scaled by 1 plus or minus up to this", ge=0, lt=1)
    dropout: float = option(0.5, "up to this share of the points is left out", ge=0, lt=1)


def checked_points(points: NDArray[np.float32]) -> Points:
    """Check points for a network. Raises ShapeError and DataError that say what is wrong."""
    values = np.asarray(points)
    if values.ndim != 2 or values.shape[1] != 3:
        raise ShapeError(f"points have shape {values.shape}, expected (N, 3)")
    if not len(values):
        raise DataError("the cloud has no points: features need at least one")
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
        raise DataError(f"point {row} is not finite: {values[row].tolist()}")
    checked: Points = values.astype(np.float32, copy=False)
    return checked


def network_input(
    points: NDArray[np.float32],
    colors: NDArray[np.uint8] | None,
    normalisation: Normalisation,
    range_m: float,
    with_colors: bool,
) -> Points:
    """Build a network's input from a cloud.

    Args:
        points: float32 (N, 3), metres.
        colors: uint8 (N, 3) RGB; needed only ``with_colors``.
        normalisation: "sphere" fits the cloud into the unit sphere around its mean, "robot" keeps
            the robot's frame and divides by ``range_m``.
        range_m: a length, metres.
        with_colors: whether columns red, green and blue, -1 to 1, follow x, y, z.

    Returns:
        float32 (N, 3) or (N, 6).

    Raises:
        ShapeError: wrong shapes, or not one colour per point.
        DataError: no points, points that are not finite, or no colours although needed.
    """
    xyz = checked_points(points)
    scaled = unit_sphere(xyz) if normalisation == "sphere" else xyz / np.float32(range_m)
    if not with_colors:
        return np.ascontiguousarray(scaled, np.float32)
    if colors is None:
        raise DataError("these weights need the colours of the points, and there are none")
    rgb = np.asarray(colors)
    if rgb.shape != xyz.shape or rgb.dtype != np.uint8:
        raise ShapeError(f"colors are {rgb.dtype} {rgb.shape}, expected uint8 {xyz.shape}")
    return np.concatenate([scaled, rgb.astype(np.float32) / 127.5 - 1], axis=1)


def unit_sphere(points: Points) -> Points:
    """Shift points to mean 0 and scale them to maximum norm 1; a single point becomes 0."""
    centred = points - points.mean(axis=0)
    longest = float(np.linalg.norm(centred, axis=1).max())
    scaled: Points = (centred / np.float32(longest or 1.0)).astype(np.float32)
    return scaled


def resampled(rows: Points, count: int, rng: np.random.Generator) -> Points:
    """Resample to exactly ``count`` rows: some are left out, or some repeated."""
    size = len(rows)
    whole = np.tile(np.arange(size), count // size)
    chosen: Points = rows[np.concatenate([whole, rng.permutation(size)[: count - len(whole)]])]
    return chosen


def augmented(points: Points, config: AugmentConfig, rng: np.random.Generator) -> Points:
    """An augmented copy of a shape, float32 (N, 3), z up; N stays the same."""
    varied = points.astype(np.float32, copy=True)
    if config.turn:
        angle = rng.uniform(0, 2 * np.pi)
        c, s = np.cos(angle), np.sin(angle)
        varied = (varied @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])).astype(np.float32)
    varied *= rng.uniform(1 - config.scale, 1 + config.scale, 3).astype(np.float32)
    noise = rng.normal(0, config.jitter, varied.shape) if config.jitter else 0.0
    varied += np.clip(noise, -5 * config.jitter, 5 * config.jitter).astype(np.float32)
    lost = rng.random(len(varied)) < rng.uniform(0, config.dropout)
    # The number of points stays, so that batches stay arrays: the first replaces dropped ones.
    varied[lost] = varied[0]
    return varied
