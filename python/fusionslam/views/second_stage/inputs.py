# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Prepares clouds for the networks: normalisation, resampling, augmentation for training."""

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Points
from fusionslam.config import Section, option
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.se2 import transform_points
from fusionslam.views.second_stage.architecture import PointNetConfig


class AugmentConfig(Section):
    """Data augmentation in training (Qi et al. 2016, 4.1; point drop-out as in PointNet++)."""

    turn: bool = option(True, "rotate about the vertical axis by a random angle")
    jitter: float = option(
        0.01, "standard deviation of each coordinate, clipped at 5 deviations", ge=0
    )
    scale: float = option(0.2, "largest relative change of scale, per axis", ge=0, lt=1)
    dropout: float = option(0.5, "largest share of points dropped", ge=0, lt=1)


def network_input(
    points: NDArray[np.float32], colors: NDArray[np.uint8] | None, config: PointNetConfig
) -> Points:
    """Build a network's input from a cloud, float32 (N, 3) or with colours (N, 6).

    Args:
        points: float32 (N, 3), metres. They are fitted into the unit sphere around their mean, or
            stay in the robot's frame and are divided by ``config.range_m``.
        colors: uint8 (N, 3) RGB, which become -1 to 1; needed only by networks with colours.
        config: of the network.

    Raises:
        ShapeError: wrong shapes, or not one colour per point.
        DataError: no points, points that are not finite, or no colours although needed.
    """
    xyz = np.asarray(points)
    if xyz.ndim != 2 or xyz.shape[1] != 3:
        raise ShapeError(f"points have shape {xyz.shape}, expected (N, 3)")
    if not len(xyz):
        raise DataError("the cloud has no points: features need at least one", code="no-points")
    if not np.isfinite(xyz).all():
        row = int(np.flatnonzero(~np.isfinite(xyz).all(axis=1))[0])
        raise DataError(
            f"point {row} is not finite: {xyz[row].tolist()}", code="not-finite", fields=[str(row)]
        )
    xyz = xyz.astype(np.float32, copy=False)
    in_sphere = config.normalisation == "sphere"
    scaled = scale_to_sphere(xyz) if in_sphere else xyz / np.float32(config.range_m)
    if not config.colors:
        return np.ascontiguousarray(scaled, np.float32)
    if colors is None:
        raise DataError(
            "these weights need the colours of the points, and there are none", code="no-colors"
        )
    rgb = np.asarray(colors)
    if rgb.shape != xyz.shape or rgb.dtype != np.uint8:
        raise ShapeError(f"colors are {rgb.dtype} {rgb.shape}, expected uint8 {xyz.shape}")
    return np.concatenate([scaled, rgb.astype(np.float32) / 127.5 - 1], axis=1)


def scale_to_sphere(points: Points) -> Points:
    """Shift points to mean 0 and scale them to maximum norm 1; a single point becomes 0."""
    centred = points - points.mean(axis=0)
    longest = float(np.linalg.norm(centred, axis=1).max())
    scaled: Points = (centred / np.float32(longest or 1.0)).astype(np.float32)
    return scaled


def resample(rows: Points, count: int, rng: np.random.Generator) -> Points:
    """Resample to exactly ``count`` rows: some are left out, or some repeated."""
    size = len(rows)
    whole = np.tile(np.arange(size), count // size)
    chosen: Points = rows[np.concatenate([whole, rng.permutation(size)[: count - len(whole)]])]
    return chosen


def augment(points: Points, config: AugmentConfig, rng: np.random.Generator) -> Points:
    """An augmented copy of a shape, float32 (N, 3), z up; N stays the same."""
    varied = points.astype(np.float32, copy=True)
    if config.turn:
        angle = rng.uniform(0, 2 * np.pi)
        varied = transform_points(varied, 0, 0, angle).astype(np.float32)
    varied *= rng.uniform(1 - config.scale, 1 + config.scale, 3).astype(np.float32)
    noise = rng.normal(0, config.jitter, varied.shape) if config.jitter else 0.0
    varied += np.clip(noise, -5 * config.jitter, 5 * config.jitter).astype(np.float32)
    lost = rng.random(len(varied)) < rng.uniform(0, config.dropout)
    # The number of points stays, so that batches stay arrays: the first replaces dropped ones.
    varied[lost] = varied[0]
    return varied
