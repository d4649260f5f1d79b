# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A graph of poses that loops correct, and that says which of them it believes."""

import time
from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusionslam._core import OdometryTree
from fusionslam.errors import DataError
from fusionslam.mapping.edge import Edge, Kind, State, check_covariance, check_kind, check_pose
from fusionslam.mapping.edge_errors import CHI2_999, chi_squares, edge_errors
from fusionslam.mapping.gtsam_extra import Measurement, Solver, load
from fusionslam.mapping.merges import FEWEST_MERGES, join_sessions, session_pair
from fusionslam.registration.result import Refusal
from fusionslam.storage.arrays import Floats, Integers, Matrix

_MOST_ROUNDS = 4  # of solving with the loops that fit


@dataclass(frozen=True, eq=False)
class Solution:
    """Poses of the nodes of a solved graph, and which loops they are based on.

    Attributes:
        poses: float64 (n, 4, 4), of each node in the frame of its part of the graph.
        parts: int64 (n), for each node the first node of the part of the graph that it is
            connected with; the poses of different parts have nothing to do with each other.
        believed, refused, pending: edges of kinds "loop" and "merge" by their state.
        reason: what is wrong with the graph as a whole; None if nothing is.
        seconds: time it took.
    """

    poses: Floats
    parts: Integers
    believed: tuple[Edge, ...]
    refused: tuple[Edge, ...]
    pending: tuple[Edge, ...] = ()
    reason: Refusal | None = None
    seconds: float = 0.0


class PoseGraph:
    """A graph of poses: odometry, loops and merges of sessions, any of which may be wrong.

    Nodes that odometry connects are a session. Its first node stays where it is.

    Args:
        sigmas: a loop that is farther from where odometry has the node is refused, in standard
            deviations of the drift of the way between and of the loop. That of a right loop
            exceeds 4.5 of them, in the direction of its error, two times in 10,000.

    Raises:
        FusionSlamError: GTSAM is not installed (code "missing-extra").
    """

    def __init__(self, *, sigmas: float = 4.5) -> None:
        load()
        self._sigmas = sigmas
        self._given: list[Matrix | None] = []  # poses by the caller
        self._edges: list[Edge] = []
        self._clear_tree()

    def __len__(self) -> int:
        return len(self._given)

    @property
    def edges(self) -> tuple[Edge, ...]:
        """All edges, by number, as the last solve left them."""
        return tuple(self._edges)

    def add_node(self, pose: Any = None) -> int:
        """Add a node.

        Args:
            pose: float64 (4, 4), of the node in the frame of its session. Only that of the first
                node of a session counts, the others follow from odometry. None: the identity.

        Returns:
            Its number, from 0.

        Raises:
            ShapeError, DataError: the pose is none (codes "not-finite", "not-a-rotation").
        """
        self._given.append(None if pose is None else check_pose("pose", pose))
        return len(self._given) - 1

    def add_edge(self, a: int, b: int, pose: Any, covariance: Any, kind: Kind) -> Edge:
        """Add an edge.

        Args:
            a, b: numbers of its nodes.
            pose: float64 (4, 4), a_from_b.
            covariance: float64 (6, 6), as in ``Edge``.
            kind: "odometry", "loop" or "merge". Odometry is believed at once, the others wait for
                ``solve``; both are treated alike: what connects sessions joins them only if
                ``FEWEST_MERGES`` such edges agree.

        Raises:
            ConfigError: there is no such kind (code "unknown-kind").
            ShapeError: the pose is not (4, 4), or the covariance not (6, 6).
            DataError: a node is unknown (code "unknown-node"), both are the same ("same-node"), a
                value is not finite ("not-finite"), the pose no rotation and translation
                ("not-a-rotation") or the covariance not positive definite
                ("not-positive-definite").
        """
        check_kind(kind)
        for name, node in (("a", a), ("b", b)):
            if not 0 <= node < len(self):
                raise DataError(
                    f"{name} is node {node}: expected one of the {len(self)} nodes, from 0",
                    code="unknown-node",
                    fields=(name, str(node)),
                )
        if a == b:
            raise DataError(
                f"an edge from node {a} to itself: expected two nodes",
                code="same-node",
                fields=("b", str(b)),
            )
        pose, covariance = check_pose("pose", pose), check_covariance("covariance", covariance)
        state: State = "believed" if kind == "odometry" else "pending"
        edge = Edge(len(self._edges), kind, int(a), int(b), pose, covariance, state)
        self._edges.append(edge)
        return edge

    def solve(self) -> Solution:
        """Decide which loops to believe, and move the nodes to where the edges fit best.

        Loops that odometry contradicts are left out at first, the others weigh less the worse they
        fit (Cauchy). Then those of all loops are believed that fit the result (chi square .999),
        and the others refused. Loops refused by earlier solves are asked again; the result depends
        on the graph alone.

        Raises:
            DataError: a node has neither odometry nor a pose (code "isolated-node").
            FusionSlamError: the graph cannot be solved (code "not-solvable").
        """
        started = time.perf_counter()
        self._grow_tree()
        self._check_isolated()
        sessions = self._sessions()
        poses = self._odometry_poses()
        loops = [edge for edge in self._edges if edge.kind != "odometry"]
        within = [edge for edge in loops if sessions[edge.a] == sessions[edge.b]]
        across = [edge for edge in loops if sessions[edge.a] != sessions[edge.b]]
        refusals = self._gate(poses, within)
        if within:
            poses, refusals = self._solve_robustly(poses, within, refusals, sessions)
        parts = sessions
        if across:
            joined = join_sessions(poses, sessions, across, self._drift)
            parts = joined.parts
            asked = [edge for edge in across if parts[edge.a] == parts[edge.b]]
            if asked:
                poses, refusals = self._solve_robustly(
                    joined.poses, within + asked, refusals, parts
                )
            refusals |= {
                edge.number: _refuse_merge(joined.agreeing[session_pair(edge, sessions)])
                for edge in across
                if parts[edge.a] != parts[edge.b]
            }
        for edge in loops:
            reason = refusals.get(edge.number)
            state: State = "believed" if reason is None else "refused"
            self._edges[edge.number] = replace(edge, state=state, reason=reason)
        loops = [self._edges[edge.number] for edge in loops]
        return Solution(
            poses,
            parts,
            tuple(edge for edge in loops if edge.state == "believed"),
            tuple(edge for edge in loops if edge.state == "refused"),
            seconds=time.perf_counter() - started,
        )

    def _clear_tree(self) -> None:
        self._tree = OdometryTree()
        self._placed: list[int] = []  # numbers of nodes in the tree
        self._place: dict[int, int] = {}  # and back
        self._taken = 0  # edges that the tree knows

    def _grow_tree(self) -> None:
        """Put new nodes into the tree of odometry."""
        new = [edge for edge in self._edges[self._taken :] if edge.kind == "odometry"]
        if not all(self._grow_by(edge) for edge in new):
            self._clear_tree()
            for edge in self._odometry_in_order():
                self._grow_by(edge)
        self._taken = len(self._edges)
        for node in range(len(self)):
            if node not in self._place:
                self._begin(node)

    def _grow_by(self, edge: Edge) -> bool:
        """False if the edge joins two sessions, so that one must be placed anew."""
        places = self._place
        if edge.a not in places and edge.b not in places:
            self._begin(min(edge.a, edge.b))
        known = [node in places for node in (edge.a, edge.b)]
        if all(known):
            a, b = places[edge.a], places[edge.b]
            return self._tree.root(a) == self._tree.root(b)
        parent, node = (edge.a, edge.b) if known[0] else (edge.b, edge.a)
        self._put(node)
        self._tree.add(places[parent], edge.pose, edge.covariance, backwards=not known[0])
        return True

    def _begin(self, node: int) -> None:
        self._put(node)
        given = self._given[node]
        self._tree.add_root(np.eye(4) if given is None else given)

    def _put(self, node: int) -> None:
        self._place[node] = len(self._placed)
        self._placed.append(node)

    def _odometry_in_order(self) -> list[Edge]:
        """Odometry in such an order that each session grows from its first node."""
        around = defaultdict(list)
        for edge in self._edges:
            if edge.kind == "odometry":
                around[edge.a].append(edge)
                around[edge.b].append(edge)
        order: dict[int, Edge] = {}
        seen: set[int] = set()
        for first in range(len(self)):
            waiting = deque([first] if first not in seen else [])
            seen.add(first)
            while waiting:
                for edge in around[waiting.popleft()]:
                    order[edge.number] = edge
                    for node in {edge.a, edge.b} - seen:
                        seen.add(node)
                        waiting.append(node)
        return list(order.values())

    def _check_isolated(self) -> None:
        driven = {node for e in self._edges if e.kind == "odometry" for node in (e.a, e.b)}
        for node, pose in enumerate(self._given):
            if node and pose is None and node not in driven:
                raise DataError(
                    f"node {node} is isolated: expected odometry that connects it, or a pose",
                    code="isolated-node",
                    fields=("node", str(node)),
                )

    def _sessions(self) -> Integers:
        """int64 (n): the first node of each node's session."""
        roots = self._tree.roots
        placed = np.array(self._placed, np.int64)
        sessions = np.empty(len(self), np.int64)
        sessions[placed] = placed[roots] if len(self) else placed
        return sessions

    def _odometry_poses(self) -> Floats:
        poses = np.empty((len(self), 4, 4))
        if len(self):
            poses[self._placed] = self._tree.poses
        return poses

    def _gate(self, poses: Floats, loops: Sequence[Edge]) -> dict[int, Refusal]:
        """Refuse the loops that contradict odometry, which has the nodes at ``poses``."""
        refusals = {}
        for edge, error in zip(loops, edge_errors(poses, loops), strict=True):
            a, b = self._place[edge.a], self._place[edge.b]
            fit = self._tree.fit(a, b, error, edge.covariance, self._sigmas)
            error_m, error_rad, allowed_m, allowed_rad = fit
            excess = max(error_m / allowed_m, error_rad / allowed_rad)
            if excess > 1:
                refusals[edge.number] = Refusal(
                    "contradicts-odometry",
                    excess,
                    f"{error_m:.3g} m and {np.degrees(error_rad):.3g} degrees from where odometry "
                    f"has the node, {allowed_m:.3g} m and {np.degrees(allowed_rad):.3g} degrees "
                    "are to be expected",
                )
        return refusals

    def _solve_robustly(
        self, poses: Floats, loops: Sequence[Edge], refused: dict[int, Refusal], parts: Integers
    ) -> tuple[Floats, dict[int, Refusal]]:
        """Solve without the refused loops, then with all that fit the others.

        Returns:
            The poses, and why the remaining ones are refused.
        """
        solver = Solver(poses, self._odometry(), np.unique(parts))
        robust = [_measure(edge, robust=True) for edge in loops if edge.number not in refused]
        if robust:
            poses = solver.solve(robust)
        squares = chi_squares(poses, loops)
        for _ in range(_MOST_ROUNDS if robust else 0):
            kept = squares <= CHI2_999
            poses = solver.solve([_measure(loops[k]) for k in np.flatnonzero(kept).tolist()])
            squares = chi_squares(poses, loops)
            if np.array_equal(kept, squares <= CHI2_999):
                break
        refusals = {}
        for edge, square in zip(loops, squares.tolist(), strict=True):
            if square > CHI2_999:
                refusals[edge.number] = refused.get(edge.number) or Refusal(
                    "contradicts-graph",
                    square,
                    f"its chi square is {square:.3g} where the other edges have the nodes, "
                    f"{CHI2_999:.3g} is to be expected",
                )
        return poses, refusals

    def _odometry(self) -> list[Measurement]:
        return [_measure(edge) for edge in self._edges if edge.kind == "odometry"]

    def _drift(self, a: int, b: int) -> Floats:
        return self._tree.drift(self._place[a], self._place[b])


def _refuse_merge(agreeing: int) -> Refusal:
    return Refusal(
        "few-merges",
        agreeing,
        f"{agreeing} of the edges between these sessions agree with each other, expected "
        f"{FEWEST_MERGES}",
    )


def _measure(edge: Edge, *, robust: bool = False) -> Measurement:
    return Measurement(edge.a, edge.b, edge.pose, edge.covariance, robust)
