# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The solver of the extra ``map``: GTSAM."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fusionslam.errors import FusionSlamError, needing
from fusionslam.storage.arrays import Floats, Integers, Matrix

# GTSAM's small motions are rotations first.
_THEIRS = np.array([3, 4, 5, 0, 1, 2])
_FIXED = 1e-6  # standard deviation of a fixed pose, m and rad
# Median error of a right measurement, in deviations (six degrees of freedom). With the width 1 that
# is usual for a single one, most right loops weigh little, and odometry wins over all of them.
_CAUCHY_WIDTH = 2.3


class Measurement(NamedTuple):
    """Pose of node b in the frame of node a, and how much it may be off.

    Attributes:
        a, b: rows of the poses.
        pose: float64 (4, 4), a_from_b.
        covariance: float64 (6, 6), as that of ``Registration``.
        robust: whether it may be wrong: its weight falls with its error (Cauchy).
    """

    a: int
    b: int
    pose: Matrix
    covariance: Floats
    robust: bool = False


def load() -> Any:
    """GTSAM's module.

    Raises:
        FusionSlamError: it is not installed (code "missing-extra").
    """
    with needing("map", "pose graphs need GTSAM"):
        import gtsam
    return gtsam


class Solver:
    """Moves poses until measurements fit best: Levenberg and Marquardt, on one thread.

    Args:
        poses: float64 (n, 4, 4), where to begin.
        measurements: between rows of ``poses``, part of every solution.
        fixed: int64 (k), rows that stay; at least one of each part that measurements connect.
        scale: factor on the stated deviations of these measurements.

    Raises:
        FusionSlamError: GTSAM is not installed (code "missing-extra").
    """

    def __init__(
        self,
        poses: Floats,
        measurements: Sequence[Measurement],
        fixed: Integers,
        scale: float = 1.0,
    ) -> None:
        self._gtsam = load()
        self._base = self._gtsam.NonlinearFactorGraph()
        hold = self._gtsam.noiseModel.Isotropic.Sigma(6, _FIXED)
        for row in fixed.tolist():
            pose = self._gtsam.Pose3(poses[row])
            self._base.add(self._gtsam.PriorFactorPose3(row, pose, hold))
        self._add(self._base, measurements, scale)
        self._values = self._gtsam.Values()
        for row, pose in enumerate(poses):
            self._values.insert(row, self._gtsam.Pose3(pose))

    def solve(self, measurements: Sequence[Measurement]) -> Floats:
        """Solve with further measurements, from where the last solution was.

        Returns:
            float64 (n, 4, 4).

        Raises:
            FusionSlamError: the measurements do not determine the poses (code "not-solvable").
        """
        graph = self._gtsam.NonlinearFactorGraph(self._base)
        self._add(graph, measurements)
        try:
            optimizer = self._gtsam.LevenbergMarquardtOptimizer(graph, self._values)
            self._values = optimizer.optimize()
        except RuntimeError as error:
            raise FusionSlamError(
                f"the pose graph cannot be solved: {error}", code="not-solvable"
            ) from error
        return _rows(self._gtsam.utilities.extractPose3(self._values))

    def _add(self, graph: Any, measurements: Sequence[Measurement], scale: float = 1.0) -> None:
        gtsam, order = self._gtsam, np.ix_(_THEIRS, _THEIRS)
        cauchy = gtsam.noiseModel.mEstimator.Cauchy.Create(_CAUCHY_WIDTH)
        for a, b, pose, covariance, robust in measurements:
            noise = gtsam.noiseModel.Gaussian.Covariance(scale**2 * covariance[order])
            if robust:
                noise = gtsam.noiseModel.Robust.Create(cauchy, noise)
            graph.add(gtsam.BetweenFactorPose3(a, b, gtsam.Pose3(pose), noise))


def _rows(values: Floats) -> Floats:
    """Poses (n, 4, 4) of GTSAM's rows (n, 12): a rotation row by row, then a translation."""
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    poses[:, :3, :3] = values[:, :9].reshape(-1, 3, 3)
    poses[:, :3, 3] = values[:, 9:]
    return poses
