# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Edges of a pose graph: what they measure, how far off they are, whether they are believed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from fusionslam.base.arrays import Floats, Matrix, read_numbers
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.geometry.rigid import is_rigid
from fusionslam.geometry.se3 import carry_covariance, inverse, log
from fusionslam.registration.result import Refusal

Kind = Literal["odometry", "loop", "merge"]
State = Literal["believed", "refused", "pending"]
BY_HAND = ("linked", "given", "fixed", "forced", "unlinked")
"""Codes of the reasons of edges that a person decided on."""


@dataclass(frozen=True, eq=False)
class Edge:
    """A measured pose of one node in the frame of another.

    Attributes:
        number: of the edge, from 0 in the order of ``PoseGraph.add_edge``.
        kind: "odometry", "loop" within a session, or "merge" between sessions.
        a, b: numbers of the nodes.
        pose: float64 (4, 4), a_from_b.
        covariance: float64 (6, 6) of the pose's error, as that of ``Registration``: x, y, z in
            metres, rotations about x, y, z in radians, as small motions in b's frame
            (``a_from_b @ exp(error)``).
        state: "believed", "refused", or "pending" until the graph is solved next.
        reason: why it is refused; None if it is not. Its ``code`` is "contradicts-odometry"
            (number: by how many times it exceeds what the gate allows), "contradicts-steps" (by how
            many standard deviations measured steps speak against it), "contradicts-graph" (its chi
            square), "few-merges" (edges between these sessions that agree with each other), or
            "unlinked", by hand. Edges that a person holds are believed with one: "linked" (number:
            the registration's probability), "given" and "fixed" (0), or "forced" (what spoke
            against it).
    """

    number: int
    kind: Kind
    a: int
    b: int
    pose: Matrix
    covariance: Floats
    state: State
    reason: Refusal | None = None

    @property
    def is_by_hand(self) -> bool:
        """Whether a person decided if it is believed: no solution asks again."""
        return isinstance(self.reason, Refusal) and self.reason.code in BY_HAND


def reverse(edge: Edge) -> Edge:
    """The same measurement, of node a in the frame of node b."""
    covariance = carry_covariance(edge.pose, edge.covariance)
    return replace(edge, a=edge.b, b=edge.a, pose=inverse(edge.pose), covariance=covariance)


def check_kind(kind: str) -> None:
    """Raise ConfigError for a kind of edge that does not exist."""
    if not isinstance(kind, str) or kind not in get_args(Kind):
        raise ConfigError(
            f"kind {kind!r}: expected {', '.join(get_args(Kind))}",
            code="unknown-kind",
            fields=("kind", str(kind)),
        )


def check_pose(name: str, pose: Any) -> Matrix:
    """Return a pose as float64 (4, 4), its rotation made exact.

    Raises:
        ShapeError: it is not (4, 4) numbers.
        DataError: a value is not finite (code "not-finite"), or it is no rotation and translation
            ("not-a-rotation"); the first field is the name.
    """
    matrix = _check_finite(name, pose, (4, 4))
    if not is_rigid(matrix):
        raise DataError(
            f"{name} is no rotation and translation: {matrix.tolist()}",
            code="not-a-rotation",
            fields=(name,),
        )
    u, _, v = np.linalg.svd(matrix[:3, :3])
    matrix[:3, :3] = u @ v
    return matrix


def check_covariance(name: str, covariance: Any) -> Floats:
    """Return a covariance as float64 (6, 6), exactly symmetric.

    Raises:
        ShapeError: it is not (6, 6) numbers.
        DataError: a value is not finite (code "not-finite"), or it is not symmetric and positive
            definite ("not-positive-definite"); the first field is the name.
    """
    matrix = _check_finite(name, covariance, (6, 6))
    scale = np.abs(matrix).max()
    symmetric = np.abs(matrix - matrix.T).max() <= 1e-6 * scale
    matrix = (matrix + matrix.T) / 2
    least = float(np.linalg.eigvalsh(matrix)[0])
    if not symmetric or least <= 1e-15 * scale:
        found = f"its smallest eigenvalue is {least:.3g}" if symmetric else "it is not symmetric"
        raise DataError(
            f"{name}: expected a covariance, positive definite; {found}",
            code="not-positive-definite",
            fields=(name,),
        )
    return matrix


def _check_finite(name: str, values: Any, shape: tuple[int, int]) -> Floats:
    matrix = read_numbers(name, values, str(shape))
    if matrix.shape != shape:
        raise ShapeError(f"{name} has shape {matrix.shape}, expected {shape}", fields=(name,))
    if not np.isfinite(matrix).all():
        raise DataError(
            f"{name}: NaN or infinity, expected numbers", code="not-finite", fields=(name,)
        )
    return matrix


CHI2_99 = 16.811893829770927
"""scipy.stats.chi2.ppf(.99, 6), without its import."""
CHI2_999 = 22.457744484825323


def chi_squares(poses: Floats, edges: Sequence[Edge]) -> Floats:
    """float64 (m): squared errors of edges in units of their covariances, of nodes' poses."""
    ends = np.array([[edge.a, edge.b] for edge in edges], np.int64).reshape(-1, 2)
    return weigh_errors(measurement_errors(poses[ends], edges), edges)


def deviations_of(covariances: Floats) -> Floats:
    """Root mean squares of errors of covariances, (..., 6, 6): (..., 2), metres and degrees."""
    variances = np.diagonal(covariances, axis1=-2, axis2=-1)
    sums = variances.reshape(*variances.shape[:-1], 2, 3).sum(axis=-1)
    return np.asarray(np.sqrt(sums.clip(0)) * [1.0, np.degrees(1.0)])


def measurement_errors(poses: Floats, edges: Sequence[Edge]) -> Floats:
    """Small motions from where edges have their nodes b to where these are.

    Args:
        poses: float64 (m, 2, 4, 4), of the nodes a and b of each edge.
        edges: m of them.

    Returns:
        float64 (m, 6).
    """
    if not edges:
        return np.empty((0, 6))
    measured = np.array([edge.pose for edge in edges])
    return log(inverse(measured) @ inverse(poses[:, 0]) @ poses[:, 1])


def weigh_errors(errors: Floats, edges: Sequence[Edge]) -> Floats:
    """float64 (m): squares of errors (m, 6) in units of the edges' covariances."""
    if not edges:
        return np.empty(0)
    covariances = np.array([edge.covariance for edge in edges])
    weighted = np.linalg.solve(covariances, errors[..., None])[..., 0]
    return np.asarray(np.einsum("ni,ni->n", errors, weighted))
