# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Tells odometry that was written another way: inverse poses, or millimetres.

Pairs of scans lie on each other by the right poses. By those of a mistake they do not, and by its
remedy they do; the drift of odometry between the two scans is far smaller than the difference.
"""

import logging
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.errors import FusionSlamError
from fusionslam.geometry.se3 import inverse

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset

logger = logging.getLogger(__name__)

_PAIRS, _FEWEST = 12, 4
_LONGEST = 50
"""Most frames from one scan of a pair to the other."""
_APART, _NEAR = 0.15, 0.03
"""Shares of the usual range: points of a pair lie this far apart by poses and their inverse, and
points this near to those of the other scan meet them."""
_BETTER, _MOSTLY = 0.15, 0.8
"""A remedy raises the share of points that meet by this, and in this share of the pairs."""
_THINNED = 1500, 8000
"""Points that are moved, and among which the nearest are found."""


def _divide(poses: Floats) -> Floats:
    metres = poses.copy()
    metres[:, :3, 3] /= 1000
    return metres


_REMEDIES: dict[str, Callable[[Floats], Floats]] = {
    "the inverse of its poses: are they camera_from_world? Expected world_from_camera": inverse,
    "its translations divided by 1000: are they millimetres? Expected metres": _divide,
}


def warn_of_wrong_odometry(dataset: "Dataset", odometry: Floats | None = None) -> None:
    """Warn if scans fit together better by the inverse of odometry, or by it in millimetres.

    Reads the clouds of at most 24 frames, and the odometry of all.

    Args:
        dataset: the recording; nothing is said of one without scans.
        odometry: float64 (N, 4, 4), odom_from_robot, NaN where unknown; None for the frames'.
    """
    if not dataset.has_points:
        return
    body_from_robot = dataset.body_from_robot
    poses = _known(dataset) if odometry is None else odometry
    poses = poses @ inverse(body_from_robot)  # of the body that a file of poses is of
    shares = np.array([*_compare_pairs(dataset, poses, body_from_robot)])
    if len(shares) < _FEWEST:
        return
    means = shares.mean(axis=0)
    best = int(np.argmax(means))
    if means[best] < means[0] + _BETTER or (shares[:, best] > shares[:, 0]).mean() < _MOSTLY:
        return
    logger.warning(
        "%s: its odometry does not fit its scans: of %d pairs of scans %.0f %% of the points meet "
        "by it, %.0f %% by %s",
        *(dataset.name, len(shares), 100 * means[0], 100 * means[best]),
        [*_REMEDIES][best - 1],
    )


def _known(dataset: "Dataset") -> Floats:
    """The odometry of all frames, float64 (N, 4, 4), NaN where unknown."""
    poses = np.full((len(dataset), 4, 4), np.nan)
    for index, pose in enumerate(poses):
        with suppress(FusionSlamError):  # of its calibration, which is refused where it is used
            if (odometry := dataset[index].odometry) is not None:
                pose[:] = odometry
    return poses


def _compare_pairs(
    dataset: "Dataset", poses: Floats, body_from_robot: Matrix
) -> Iterator[list[float]]:
    """Yield the share of points that meet by the poses, and by each remedy, of some pairs."""
    ways = [poses, *(remedy(poses) for remedy in _REMEDIES.values())]
    for first in np.unique(np.linspace(0, max(len(poses) - 2, 0), _PAIRS).astype(int)):
        target = _scan(dataset, first, body_from_robot, _THINNED[1])
        if not len(target):
            continue
        reach = float(np.median(np.linalg.norm(target, axis=1)))
        second = _far_enough(poses, ways[1], first, _APART * reach, reach)
        source = None if second is None else _scan(dataset, second, body_from_robot, _THINNED[0])
        if source is None or not len(source):
            continue
        tree, shares = cKDTree(target), []
        for way in ways:
            moved = _move(inverse(way[first]) @ way[second], source)
            apart, _ = tree.query(moved, distance_upper_bound=_NEAR * reach)
            shares.append(float(np.isfinite(apart).mean()))
        yield shares


def _far_enough(
    poses: Floats, inverted: Floats, first: int, apart: float, reach: float
) -> int | None:
    """The next frame by which the poses and their inverse differ for points at this reach."""
    for second in range(first + 1, min(first + 1 + _LONGEST, len(poses))):
        step, back = (inverse(way[first]) @ way[second] for way in (poses, inverted))
        off = inverse(step) @ back
        if not np.isfinite(off).all():
            continue
        turn = Rotation.from_matrix(off[:3, :3]).magnitude()
        if np.linalg.norm(off[:3, 3]) + reach * turn > apart:
            return second
    return None


def _move(motion: Matrix, points: Floats) -> Floats:
    # Not a matrix product: BLAS would start all its threads for three columns.
    return np.asarray(np.einsum("ij,kj->ik", points, motion[:3, :3]) + motion[:3, 3])


def _scan(dataset: "Dataset", index: int, body_from_robot: Matrix, most: int) -> Floats:
    """Points of a frame in the body's frame, float64 (n, 3); none of a frame that is unreadable."""
    try:
        frame = dataset[index]
        points = np.asarray(frame.points, np.float64)
    except (FusionSlamError, ValueError, TypeError):  # who uses the frame says what is wrong
        return np.empty((0, 3))
    if points.ndim != 2 or points.shape[1] != 3:
        return np.empty((0, 3))
    some = points[:: 1 + len(points) // most]
    some = some[np.isfinite(some).all(axis=1) & some.any(axis=1)]
    robot_from_points = np.eye(4) if frame.robot_from_points is None else frame.robot_from_points
    return _move(body_from_robot @ robot_from_points, some)
