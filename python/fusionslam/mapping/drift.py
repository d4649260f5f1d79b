# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How far odometry may be off between two nodes."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fusionslam.geometry.se3 import adjoint, inverse, log
from fusionslam.storage.arrays import Floats, Matrix


class Fit(NamedTuple):
    """How a measured pose fits odometry.

    Attributes:
        error_m, error_rad: its distance from where odometry has the node.
        allowed_m, allowed_rad: the distance that is to be expected at most.
    """

    error_m: float
    error_rad: float
    allowed_m: float
    allowed_rad: float

    @property
    def excess(self) -> float:
        """Largest ratio of an error to what is allowed: it fits up to 1."""
        return max(self.error_m / self.allowed_m, self.error_rad / self.allowed_rad)


@dataclass
class OdometryTree:
    """Poses of nodes by odometry alone, and the drift between any two that odometry connects.

    Covariances of steps add up along the way, each carried to the way's end: an error of rotation
    moves the end in proportion to its distance.
    """

    poses: list[Matrix] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    roots: list[int] = field(default_factory=list)
    _sums: list[Floats] = field(default_factory=list)  # from the root, at the origin
    _depths: list[int] = field(default_factory=list)
    _jumps: list[int] = field(default_factory=list)

    def add_root(self, pose: Matrix) -> None:
        """Add a node that odometry begins at."""
        node = len(self.poses)
        self._append(pose, node, node, np.zeros((6, 6)), 0, node)

    def add(self, parent: int, step: Matrix, covariance: Floats, *, backwards: bool) -> None:
        """Add a node at the end of a step of odometry.

        Args:
            parent: the node at the other end.
            step: float64 (4, 4), parent_from_node; ``backwards``: node_from_parent.
            covariance: float64 (6, 6) of the step's error, in the frame of its last node.
            backwards: whether the step leads from the new node to its parent.
        """
        before = self.poses[parent]
        pose = before @ (inverse(step) if backwards else step)
        carry = adjoint(before if backwards else pose)
        jump = self._jumps[parent]
        if (
            self._depths[parent] - self._depths[jump]
            == self._depths[jump] - self._depths[self._jumps[jump]]
        ):
            jump = self._jumps[jump]
        else:
            jump = parent
        total = self._sums[parent] + carry @ covariance @ carry.T
        self._append(pose, parent, self.roots[parent], total, self._depths[parent] + 1, jump)

    def fit(self, a: int, b: int, pose: Matrix, covariance: Floats, sigmas: float) -> Fit:
        """Compare a measured pose a_from_b with odometry between nodes of one root."""
        error = log(inverse(pose) @ self.between(a, b))
        total = covariance + self.drift(a, b)
        parts = []
        for rows in (slice(0, 3), slice(3, 6)):
            square = float(error[rows] @ error[rows])
            spread = total[rows, rows]
            along = (
                float(error[rows] @ spread @ error[rows]) / square
                if square > 0
                else float(np.linalg.eigvalsh(spread)[-1])
            )
            parts.append((np.sqrt(square), sigmas * np.sqrt(along)))
        (error_m, allowed_m), (error_rad, allowed_rad) = parts
        return Fit(error_m, error_rad, allowed_m, allowed_rad)

    def between(self, a: int, b: int) -> Matrix:
        """float64 (4, 4), a_from_b by odometry."""
        return inverse(self.poses[a]) @ self.poses[b]

    def drift(self, a: int, b: int) -> Floats:
        """float64 (6, 6), covariance of the error of a_from_b by odometry, in b's frame."""
        total = self._sums[a] + self._sums[b] - 2 * self._sums[self._meet(a, b)]
        carry = adjoint(inverse(self.poses[b]))
        return np.asarray(carry @ total @ carry.T)

    def _append(
        self, pose: Matrix, parent: int, root: int, total: Floats, depth: int, jump: int
    ) -> None:
        self.poses.append(pose)
        self.parents.append(parent)
        self.roots.append(root)
        self._sums.append(total)
        self._depths.append(depth)
        self._jumps.append(jump)

    def _meet(self, a: int, b: int) -> int:
        """The node at which the ways from both to their root meet (Myers 1983)."""
        a, b = sorted((a, b), key=self._depths.__getitem__)
        while self._depths[b] > self._depths[a]:
            jump = self._jumps[b]
            b = jump if self._depths[jump] >= self._depths[a] else self.parents[b]
        while a != b:
            if self._jumps[a] != self._jumps[b]:
                a, b = self._jumps[a], self._jumps[b]
            else:
                a, b = self.parents[a], self.parents[b]
        return a
