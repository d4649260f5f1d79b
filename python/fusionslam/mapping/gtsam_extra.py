# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The solver of the extra ``map``: GTSAM."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from fusionslam.base.arrays import Floats, Integers, Matrix
from fusionslam.errors import FusionSlamError, needing
from fusionslam.mapping.edge import Edge

# GTSAM's small motions are rotations first.
_THEIRS = np.array([3, 4, 5, 0, 1, 2])
_FIXED = 1e-6  # standard deviation of a fixed pose, m and rad
# Median error of a right measurement, in deviations (six degrees of freedom). With the width 1 that
# is usual for a single one, most right loops weigh little, and odometry wins over all of them.
_CAUCHY_WIDTH = 2.3
_ANCHOR_WIDTHS = {"huber": 1.5, "cauchy": 1.5}
"""Of kernels for measured positions: about the median error, three degrees of freedom."""
_LEVEL = np.array([0.05, 0.05, 1e3, 1e6, 1e6, 1e6])  # tilt, heading in rad, position in m


def load() -> Any:
    """GTSAM's module.

    Raises:
        FusionSlamError: it is not installed (code "missing-extra").
    """
    with needing("map", "pose graphs need GTSAM"):
        import gtsam
    return gtsam


class Anchor(NamedTuple):
    """A measured position of a point that is fixed to a node.

    Attributes:
        row: of the node.
        arm: float64 (3), the point in the node's frame.
        point: float64 (3), measured, in the frame of the poses.
        covariance: float64 (3, 3), of the measurement.
    """

    row: int
    arm: Matrix
    point: Matrix
    covariance: Floats


class Solver:
    """Moves poses until edges fit best: Levenberg and Marquardt, on one thread.

    Args:
        poses: float64 (n, 4, 4), where to begin.
        edges: between rows of ``poses``, part of every solution.
        fixed: int64 (k), rows that stay; at least one of each part that edges connect, unless
            anchors hold it.
        scale: factor on the stated deviations of these edges.
        held: edges that are part of every solution as they are.
        level: row whose tilt holds loosely, where anchors hold the rest.

    Raises:
        FusionSlamError: GTSAM is not installed (code "missing-extra").
    """

    def __init__(
        self,
        poses: Floats,
        edges: Sequence[Edge],
        fixed: Integers,
        scale: float = 1.0,
        held: Sequence[Edge] = (),
        *,
        level: int | None = None,
    ) -> None:
        self._gtsam = load()
        self._base = self._gtsam.NonlinearFactorGraph()
        hold = self._gtsam.noiseModel.Isotropic.Sigma(6, _FIXED)
        for row in fixed.tolist():
            pose = self._gtsam.Pose3(poses[row])
            self._base.add(self._gtsam.PriorFactorPose3(row, pose, hold))
        if level is not None:
            loose = self._gtsam.noiseModel.Diagonal.Sigmas(_LEVEL)
            pose = self._gtsam.Pose3(poses[level])
            self._base.add(self._gtsam.PriorFactorPose3(level, pose, loose))
        self._add(self._base, edges, scale)
        self._add(self._base, held)
        self._values = self._gtsam.Values()
        for row, pose in enumerate(poses):
            self._values.insert(row, self._gtsam.Pose3(pose))

    def solve(
        self,
        edges: Sequence[Edge],
        *,
        robust: bool = False,
        anchors: Sequence[Anchor] = (),
        kernel: Literal["huber", "cauchy"] | None = None,
    ) -> Floats:
        """Solve with further edges, from where the last solution was.

        Args:
            edges: between rows of the poses.
            robust: whether they may be wrong: their weights fall with their errors (Cauchy).
            anchors: measured positions.
            kernel: by which their weights fall with their errors; None: they do not.

        Returns:
            float64 (n, 4, 4).

        Raises:
            FusionSlamError: the edges do not determine the poses (code "not-solvable").
        """
        graph = self._gtsam.NonlinearFactorGraph(self._base)
        self._add(graph, edges, robust=robust)
        self._hold(graph, anchors, kernel)
        try:
            optimizer = self._gtsam.LevenbergMarquardtOptimizer(graph, self._values)
            self._values = optimizer.optimize()
        except RuntimeError as error:
            raise FusionSlamError(
                f"the pose graph cannot be solved: {error}", code="not-solvable"
            ) from error
        return _rows(self._gtsam.utilities.extractPose3(self._values))

    def covariances(self) -> Floats:
        """Marginal covariances of the poses where they are, float64 (n, 6, 6), as of ``Edge``.

        Raises:
            FusionSlamError: the edges do not determine the poses (code "not-solvable").
        """
        try:
            marginals = self._gtsam.Marginals(self._base, self._values)
            found = [marginals.marginalCovariance(row) for row in range(self._values.size())]
        except RuntimeError as error:
            raise FusionSlamError(
                f"the pose graph has no covariances: {error}", code="not-solvable"
            ) from error
        covariances = np.array(found).reshape(-1, 6, 6)
        return covariances[:, _THEIRS[:, None], _THEIRS]

    def _add(
        self, graph: Any, edges: Sequence[Edge], scale: float = 1.0, *, robust: bool = False
    ) -> None:
        gtsam, order = self._gtsam, np.ix_(_THEIRS, _THEIRS)
        cauchy = gtsam.noiseModel.mEstimator.Cauchy.Create(_CAUCHY_WIDTH)
        for each in edges:
            noise = gtsam.noiseModel.Gaussian.Covariance(scale**2 * each.covariance[order])
            if robust:
                noise = gtsam.noiseModel.Robust.Create(cauchy, noise)
            graph.add(gtsam.BetweenFactorPose3(each.a, each.b, gtsam.Pose3(each.pose), noise))

    def _hold(self, graph: Any, anchors: Sequence[Anchor], kernel: str | None) -> None:
        model, kind = self._gtsam.noiseModel, self._gtsam.noiseModel.mEstimator
        kernels = {"huber": kind.Huber, "cauchy": kind.Cauchy}
        for each in anchors:
            noise = model.Gaussian.Covariance(each.covariance)
            if kernel is not None:
                estimator = kernels[kernel].Create(_ANCHOR_WIDTHS[kernel])
                noise = model.Robust.Create(estimator, noise)
            graph.add(self._gtsam.GPSFactorArm(each.row, each.point, each.arm, noise))


def _rows(values: Floats) -> Floats:
    """Poses (n, 4, 4) of GTSAM's rows (n, 12): a rotation row by row, then a translation."""
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    poses[:, :3, :3] = values[:, :9].reshape(-1, 3, 3)
    poses[:, :3, 3] = values[:, 9:]
    return poses
