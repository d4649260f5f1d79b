# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Poses while driving: each loop moves the session's nodes, with bounded work."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from fusionslam._core import OdometryTree
from fusionslam.base.arrays import Floats, Integers, Matrix
from fusionslam.geometry.se3 import exp, inverse, log
from fusionslam.mapping.edge import CHI2_999, Edge, reverse
from fusionslam.mapping.gtsam_extra import Solver

_NEWEST, _OLDER = 10, 20
"""Loops that are solved together: the newest ones, and as many spread over the others."""


class Window:
    """Current poses of nodes in the order in which odometry reached them.

    Nodes between two loops are one step of odometry, with the drift of the way between, and few
    loops stand for all, so that the work for a new one does not depend on the number of nodes.

    Args:
        tree: the odometry.
        poses: float64 (n, 4, 4), of its nodes by now.
        loops: that these poses follow from, as ``close`` takes them.
    """

    def __init__(self, tree: OdometryTree, poses: Floats, loops: Sequence[Edge] = ()) -> None:
        self._tree = tree
        self._poses = poses.copy()  # without what loops have moved since
        self._count = len(poses)
        # Between numbers of the tree, b newer than a, by the first node of b's session.
        self._loops: defaultdict[int, list[Edge]] = defaultdict(list)
        self._knots = np.zeros(1, np.int64)  # ends of loops, the first node of the session before
        self._moves = np.eye(4)[None]  # of the knots, in the frame of the poses
        if len(poses):
            self._begin(tree.root(len(poses) - 1))
        self._keep(loops)

    def __len__(self) -> int:
        return self._count

    @property
    def poses(self) -> Floats:
        """float64 (n, 4, 4)."""
        return self.at(np.arange(self._count))

    def at(self, numbers: Integers) -> Floats:
        """float64 (m, 4, 4): current poses of some nodes, (m)."""
        knots, moves = self._knots, self._moves
        if len(knots) == 1:
            return np.asarray(self._poses[numbers])
        own = np.array([self._tree.root(number) == knots[0] for number in numbers.tolist()])
        part = np.clip(np.searchsorted(knots, numbers, side="right") - 1, 0, len(knots) - 2)
        shares = np.clip((numbers - knots[part]) / (knots[part + 1] - knots[part]), 0, 1)
        between = log(moves[1:] @ inverse(moves[:-1]))
        moved = exp(shares[:, None] * between[part]) @ moves[part]
        poses = self._poses[numbers]
        return np.where(own[:, None, None], moved @ poses, poses)

    def grow(self, parents: Sequence[int], steps: Mapping[int, Edge]) -> None:
        """Take in the nodes that odometry has reached since, each with its parent.

        Args:
            parents: of the nodes.
            steps: measurements of the way from its parent, by node.
        """
        for parent in parents:
            node = self._count
            if node == len(self._poses):
                room = np.empty((max(64, 2 * node), 4, 4))
                room[:node] = self._poses
                self._poses = room
            self._count += 1
            if self._tree.root(node) != self._knots[0] or node == 0:
                # The nodes of the session stay for good where loops have moved them.
                before = np.arange(self._knots[0], self._count - 1)  # this node has no pose yet
                self._poses[before] = self.at(before)
                self._begin(self._tree.root(node))
            if parent == node:
                self._poses[node] = self._tree.pose(node)
                continue
            step = inverse(self._tree.pose(parent)) @ self._tree.pose(node)
            if node in steps:
                step = fuse_step(step, self._tree.drift(parent, node), steps[node])
            self._poses[node] = self._poses[parent] @ step

    def close(self, loops: Sequence[Edge]) -> None:
        """Move the nodes of the newest session to where loops fit best.

        Args:
            loops: between nodes of the tree, a earlier than b. Those that end in another session
                wait until it goes on.
        """
        first = int(self._knots[0])
        before = len(self._loops[first])
        self._keep(loops)
        loops = self._loops[first]
        if len(loops) == before:
            return
        older = np.linspace(0, len(loops) - _NEWEST - 1, _OLDER)
        spread = np.unique(older.astype(int)).tolist() if len(loops) > _NEWEST else []
        asked = [loops[k] for k in spread] + loops[-_NEWEST:]
        ends = {end for loop in asked for end in (loop.a, loop.b)} - {first}
        own = {end for end in ends if self._tree.root(end) == first}
        knots, others = np.array([first, *sorted(own)]), np.array(sorted(ends - own), np.int64)
        numbers = np.concatenate([knots, others])
        rows = {int(number): row for row, number in enumerate(numbers)}
        bases = self._poses[knots]
        steps = [
            Edge(
                row,
                "odometry",
                row,
                row + 1,
                inverse(bases[row]) @ bases[row + 1],
                self._tree.drift(a, b),
                "believed",
            )
            for row, (a, b) in enumerate(pairwise(knots.tolist()))
        ]
        fixed = np.array([0, *range(len(knots), len(numbers))])
        solver = Solver(self.at(numbers), steps, fixed)
        moved = [replace(loop, a=rows[loop.a], b=rows[loop.b]) for loop in asked]
        solved = solver.solve(moved, robust=True)
        self._knots = knots
        self._moves = solved[: len(knots)] @ inverse(bases)

    def _keep(self, loops: Sequence[Edge]) -> None:
        for loop in loops:
            self._loops[self._tree.root(loop.b)].append(loop)

    def _begin(self, node: int) -> None:
        """Begin a session, or go on with it, by its first node."""
        self._knots, self._moves = np.array([node]), np.eye(4)[None]


def between_places(edge: Edge, a: int, b: int) -> Edge:
    """An edge between the places of its nodes, from the earlier to the newer one."""
    first, last = sorted((a, b))
    return replace(edge if a < b else reverse(edge), a=first, b=last)


def fuse_step(step: Matrix, drift: Floats, measured: Edge) -> Matrix:
    """A step by odometry and by a measurement; by odometry alone if the two contradict."""
    error = log(inverse(step) @ measured.pose)
    weighed = np.linalg.solve(drift + measured.covariance, error)
    if error @ weighed > CHI2_999:
        return step
    fused: Matrix = step @ exp(drift @ weighed)
    return fused
