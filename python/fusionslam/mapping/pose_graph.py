# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A graph of poses that loops correct, and that says which of them it believes."""

import time
from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fusionslam._core import OdometryTree
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers, Matrix
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.geometry.globe import MapOrigin
from fusionslam.mapping.edge import (
    CHI2_999,
    Edge,
    Kind,
    State,
    check_covariance,
    check_kind,
    check_pose,
    chi_squares,
    measurement_errors,
    weigh_errors,
)
from fusionslam.mapping.gtsam_extra import Solver, load
from fusionslam.mapping.guard import agreeing_scale, oppose_loops
from fusionslam.mapping.merges import FEWEST_MERGES, join_sessions, session_pair
from fusionslam.mapping.overconfidence import MOST, chi_ratio, fit_scale
from fusionslam.mapping.satellites import Position, place_on_globe
from fusionslam.mapping.window import Window, between_places
from fusionslam.registration.result import Refusal

_MOST_ROUNDS = 4  # of solving with the loops that fit
_FEWEST_AGREEING = 10  # loops by which odometry is judged
_MOST_REFUSED = 0.2  # part of loops that agree beyond which something is said
_MARGIN = 1.5  # by which odometry counts less than it should while agreeing loops are looked for
_HONEST = 1.5  # squared errors of a graph, of those to be expected, up to which odometry is


@dataclass(frozen=True, eq=False)
class Solution:
    """Poses of the nodes of a solved graph, and which loops they are based on.

    Attributes:
        poses: float64 (n, 4, 4), of each node in the frame of its part of the graph.
        parts: int64 (n), for each node the first node of the part of the graph that it is
            connected with; the poses of different parts have nothing to do with each other.
        believed, refused, pending: edges of kinds "loop" and "merge" by their state.
        reason: what is wrong with the graph as a whole; None if nothing is. Its code is
            "overconfident-odometry" where odometry contradicts more than a fifth of the loops that
            agree with each other (number: the factor by which its stated deviations are too small),
            or "contradicts-steps" where loops are refused that odometry allows, as the steps that
            clouds measured speak against them (number: of these loops).
        seconds: time it took.
        places: where on the globe each part with measured positions is, or why they do not tell it,
            by the first node of the part.
    """

    poses: Floats
    parts: Integers
    believed: tuple[Edge, ...]
    refused: tuple[Edge, ...]
    pending: tuple[Edge, ...] = ()
    reason: Refusal | None = None
    seconds: float = 0.0
    places: Mapping[int, MapOrigin | Refusal] = field(default_factory=dict)

    @property
    def origin(self) -> MapOrigin | None:
        """Where on the globe the part of node 0 is; None without positions that say so."""
        place = self.places.get(0)
        return place if isinstance(place, MapOrigin) else None

    @property
    def unplaced(self) -> Refusal | None:
        """Why positions do not say so; None if they do, or there are none."""
        place = self.places.get(0)
        return place if isinstance(place, Refusal) else None


@dataclass(frozen=True, eq=False)
class Update:
    """Where the newest node is while driving.

    Attributes:
        pose: float64 (4, 4), of the newest node in the frame of its part of the graph; None
            without nodes.
        edges: the loops and merges that were added since the last update or solve, with states as
            far as known: "believed" where they fit the poses now, "refused" where odometry
            contradicts them, and "pending" until the next solve.
    """

    pose: Matrix | None
    edges: tuple[Edge, ...]


@checked
class PoseGraph:
    """A graph of poses: odometry, loops and merges of sessions, any of which may be wrong.

    Nodes that odometry connects are a session. Its first node stays where it is. A graph has no
    lock: threads that share one take turns by a lock of their own, for reading, too.

    Args:
        sigmas: a loop that is farther from where odometry has the node is refused, in standard
            deviations of the drift of the way between and of the loop. That of a right loop
            exceeds 4.5 of them, in the direction of its error, two times in 10,000.

    Attributes:
        positions: that ``set_positions`` took.

    Raises:
        FusionSlamError: GTSAM is not installed (code "missing-extra").
        ConfigError: sigmas is not above 0 (code "out-of-range").
    """

    def __init__(self, *, sigmas: float = 4.5) -> None:
        load()
        if not 0 < sigmas < np.inf:
            raise ConfigError(
                f"sigmas is {sigmas}, expected more than 0",
                code="out-of-range",
                fields=("sigmas", str(sigmas)),
            )
        self._sigmas = sigmas
        self._given: list[Matrix | None] = []  # poses by the caller
        self._edges: list[Edge] = []
        self.positions: list[Position] = []
        self._updated = 0  # edges that update() or solve() has seen
        self._parts = np.empty(0, np.int64)  # of nodes in the last solution
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

    def add_edge(
        self,
        a: int,
        b: int,
        pose: Any,
        covariance: Any,
        kind: Kind,
        by_hand: Refusal | None = None,
    ) -> Edge:
        """Add an edge.

        Args:
            a, b: numbers of its nodes.
            pose: float64 (4, 4), a_from_b.
            covariance: float64 (6, 6), as in ``Edge``.
            kind: "odometry", "loop" or "merge". Odometry is believed at once, the others wait for
                ``solve``; both are treated alike: what connects sessions joins them only if
                ``FEWEST_MERGES`` such edges agree.
            by_hand: what a person decided of a loop or merge, with a code of ``BY_HAND``:
                "unlinked" is always refused, others are always believed, and join sessions alone.

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
            self._check_node(name, node, len(self))
        if a == b:
            raise DataError(
                f"an edge from node {a} to itself: expected two nodes",
                code="same-node",
                fields=("b", str(b)),
            )
        pose, covariance = check_pose("pose", pose), check_covariance("covariance", covariance)
        state: State = "believed" if kind == "odometry" or by_hand is not None else "pending"
        if by_hand is not None and by_hand.code == "unlinked":
            state = "refused"
        edge = Edge(len(self._edges), kind, int(a), int(b), pose, covariance, state, by_hand)
        self._edges.append(edge)
        return edge

    def set_positions(self, positions: Sequence[Position]) -> None:
        """Take measured positions, in the order of time, instead of those it had.

        ``solve`` puts each part where its positions say, once it has chosen its loops; the part's
        first node then keeps its place and heading, but not its tilt.

        Raises:
            ShapeError: other values than ``Position``.
            DataError: a node is unknown (code "unknown-node").
        """
        for each in positions:
            if not isinstance(each, Position):
                raise ShapeError(f"expected Positions, got {type(each).__name__}")
            self._check_node("node", each.node, len(self))
        self.positions = list(positions)

    def solve(self) -> Solution:
        """Decide which loops to believe, and move the nodes to where the edges fit best.

        Loops that odometry or measured steps contradict are left out at first, the others weigh
        less the worse they fit (Cauchy).
        Then those of all loops are believed that fit the result (chi square .999), and the others
        refused. Odometry that is better than it states counts for more, as far as all its loops
        agree with it. Loops refused by earlier solves are asked again; the result depends on the
        graph alone.

        Raises:
            DataError: a node has neither odometry nor a pose (code "isolated-node").
            FusionSlamError: the graph cannot be solved (code "not-solvable").
        """
        started = time.perf_counter()
        self._grow_tree()
        self._check_isolated()
        sessions = self._sessions()
        poses = self._odometry_poses()
        loops = [e for e in self._edges if e.kind != "odometry" and not e.is_by_hand]
        within = [edge for edge in loops if sessions[edge.a] == sessions[edge.b]]
        across = [edge for edge in loops if sessions[edge.a] != sessions[edge.b]]
        held = [edge for edge in self._edges if edge.is_by_hand and edge.state == "believed"]
        held_across = [edge for edge in held if sessions[edge.a] != sessions[edge.b]]
        refusals = self._gate(within)
        ways = self._measure_ways([edge for edge in within if edge.number not in refusals])
        steps = {way.b: way for way in ways if self._is_step(way)}
        ways = [way for way in ways if steps.get(way.b) is not way]
        opposed = oppose_loops(self._tree, steps, ways, self._sigmas)
        refusals |= opposed
        scale = agreeing_scale(self._tree, [way for way in ways if way.number not in opposed])
        if within or held:
            poses, refusals = self._solve_robustly(poses, within, refusals, sessions, scale)
        parts = sessions
        if across or held_across:
            drift, place = self._tree.drift, self._place
            joined = join_sessions(
                poses, sessions, across + held_across, lambda a, b: drift(place[a], place[b])
            )
            parts = joined.parts
            asked = [edge for edge in across if parts[edge.a] == parts[edge.b]]
            if asked or held_across:
                poses, refusals = self._solve_robustly(
                    joined.poses, within + asked, refusals, parts, scale
                )
            for edge in across:
                if parts[edge.a] != parts[edge.b]:
                    agreeing = joined.agreeing[session_pair(edge, sessions)]
                    text = (
                        f"{agreeing} of the edges between these sessions agree with each other, "
                        f"expected {FEWEST_MERGES}"
                    )
                    refusals[edge.number] = Refusal("few-merges", agreeing, text)
        for edge in loops:
            reason = refusals.get(edge.number)
            state: State = "believed" if reason is None else "refused"
            self._edges[edge.number] = replace(edge, state=state, reason=reason)
        loops = [edge for edge in self._edges if edge.kind != "odometry"]
        self._updated, self._parts = len(self._edges), parts
        believed = [edge for edge in loops if edge.state == "believed"]
        held = [way for way in self._measure_ways(believed) if not self._is_step(way)]
        self._window = Window(self._tree, poses[self._placed], held)
        reason = self._find_overconfidence(
            sessions, [edge for edge in within if edge.number not in opposed]
        )
        left_out = sum(self._edges[number].state == "refused" for number in opposed)
        if reason is None and left_out:
            text = (
                f"{left_out} of {len(ways)} loops that odometry allows are refused: the steps that "
                "clouds measured on the way speak against them"
            )
            reason = Refusal("contradicts-steps", left_out, text)
        places: dict[int, MapOrigin | Refusal] = {}
        told: dict[int, list[Position]] = {}
        for position in self.positions:
            told.setdefault(int(parts[position.node]), []).append(position)
        for part, positions in told.items():
            here = np.flatnonzero(parts == part)
            used = [e for e in self._edges if e.state == "believed" and parts[e.a] == part]
            placement = place_on_globe(poses, here, used, positions)
            if isinstance(placement, Refusal):
                places[part] = placement
            else:
                places[part], poses = placement.origin, poses.copy()
                poses[here] = placement.poses
                self._window = Window(self._tree, poses[self._placed], held)
        return Solution(
            poses,
            parts,
            tuple(believed),
            tuple(edge for edge in loops if edge.state == "refused"),
            reason=reason,
            seconds=time.perf_counter() - started,
            places=places,
        )

    def update(self) -> Update:
        """Take in what was added since the last call, with work that does not grow with the graph.

        A node is put where odometry leads from the one before, and a loop between these two, if it
        fits, which measures the same step. Other loops move the newest nodes only, and those
        between the last loops; ``solve`` moves all. The first update, and one after odometry that
        joins nodes already seen, takes time for each node. Add a node's odometry before its update.
        """
        self._grow_tree()
        new = [edge for edge in self._edges[self._updated :] if edge.kind != "odometry"]
        self._updated = len(self._edges)
        here = [edge for edge in new if self._part(edge.a) == self._part(edge.b)]
        judged = [edge for edge in here if not edge.is_by_hand]
        refusals = self._gate([e for e in judged if self._session(e.a) == self._session(e.b)])
        refused = {edge.number for edge in here if edge.state == "refused"} | refusals.keys()
        asked = [edge for edge in here if edge.number not in refused]
        window, ways = self._window, self._measure_ways(asked)
        steps = {way.b: way for way in ways if way.b >= len(window) and self._is_step(way)}
        window.grow([self._tree.parent(k) for k in range(len(window), len(self))], steps)
        window.close([way for way in ways if steps.get(way.b) is not way])
        for edge in (each for each in asked if not each.is_by_hand):
            ends = np.array([self._place[edge.a], self._place[edge.b]])
            square = weigh_errors(measurement_errors(window.at(ends)[None], [edge]), [edge])[0]
            state: State = "believed" if square <= CHI2_999 else "pending"
            self._edges[edge.number] = replace(edge, state=state)
        for number, reason in refusals.items():
            self._edges[number] = replace(self._edges[number], state="refused", reason=reason)
        pose = self.pose(len(self) - 1) if len(self) else None
        return Update(pose, tuple(self._edges[edge.number] for edge in new))

    def pose(self, node: int) -> Matrix:
        """float64 (4, 4): where the last update or solve has a node that it knew.

        Raises:
            DataError: it knew no such node (code "unknown-node").
        """
        self._check_node("node", node, self._known)
        pose: Matrix = self._window.at(np.array([self._place[node]]))[0]
        return pose

    @staticmethod
    def _check_node(name: str, node: int, count: int) -> None:
        if not isinstance(node, (int, np.integer)) or not 0 <= node < count:
            raise DataError(
                f"{name} is {str(node)[:50]}: expected one of the {count} nodes, from 0",
                code="unknown-node",
                fields=(name, str(node)[:50]),
            )

    def _measure_ways(self, edges: Sequence[Edge]) -> list[Edge]:
        """The edges between places in the tree, from the earlier to the newer one."""
        return [between_places(e, self._place[e.a], self._place[e.b]) for e in edges]

    def _is_step(self, way: Edge) -> bool:
        """Whether it leads from a node to the next by odometry."""
        return self._tree.parent(way.b) == way.a

    @property
    def poses(self) -> Floats:
        """float64 (n, 4, 4): where the last update or solve has the nodes it knew."""
        poses = np.empty((len(self._placed), 4, 4))
        poses[self._placed] = self._window.poses
        return poses

    def _session(self, node: int) -> int:
        return self._tree.root(self._place[node])

    def _part(self, node: int) -> int:
        """The first node of the part that a node is connected with by now."""
        first = self._placed[self._session(node)]
        return int(self._parts[first]) if first < len(self._parts) else first

    def _clear_tree(self) -> None:
        self._tree = OdometryTree()
        self._known = 0  # nodes that the tree knows
        self._placed: list[int] = []  # their numbers, in its order
        self._place: dict[int, int] = {}  # and back
        self._taken = 0  # edges that the tree knows
        self._window = Window(self._tree, np.empty((0, 4, 4)))

    def _grow_tree(self) -> None:
        """Put new nodes into the tree of odometry."""
        new = [edge for edge in self._edges[self._taken :] if edge.kind == "odometry"]
        if not all(self._grow_by(edge) for edge in new):
            self._clear_tree()
            self._updated, self._parts = 0, np.empty(0, np.int64)
            for edge in self._odometry_in_order():
                self._grow_by(edge)
        self._taken = len(self._edges)
        for node in range(self._known, len(self)):
            if node not in self._place:
                self._begin(node)
        self._known = len(self)

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

    def _gate(self, loops: Sequence[Edge], scale: float = 1.0) -> dict[int, Refusal]:
        """Refuse the loops that contradict odometry, whose deviations are multiplied."""
        refusals = {}
        places = [(self._place[edge.a], self._place[edge.b]) for edge in loops]
        poses = np.array([[self._tree.pose(a), self._tree.pose(b)] for a, b in places])
        errors = measurement_errors(poses, loops)
        for edge, (a, b), error in zip(loops, places, errors, strict=True):
            fit = self._tree.fit(a, b, error, edge.covariance / scale**2, scale * self._sigmas)
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
        self,
        poses: Floats,
        loops: Sequence[Edge],
        refused: dict[int, Refusal],
        parts: Integers,
        scale: float = 1.0,
    ) -> tuple[Floats, dict[int, Refusal]]:
        """Solve without the refused loops, then with all that fit the others; held ones count.

        ``scale`` is a factor on odometry's deviations.

        Returns:
            The poses, and why the remaining ones are refused.
        """
        odometry = [edge for edge in self._edges if edge.kind == "odometry"]
        held = [
            edge
            for edge in self._edges
            if edge.is_by_hand and edge.state == "believed" and parts[edge.a] == parts[edge.b]
        ]
        solver = Solver(poses, odometry, np.unique(parts), scale, held)
        robust = [edge for edge in loops if edge.number not in refused]
        if robust or held:
            poses = solver.solve(robust, robust=True)
        squares = chi_squares(poses, loops)
        for _ in range(_MOST_ROUNDS if robust or held else 0):
            kept = squares <= CHI2_999
            poses = solver.solve([loops[k] for k in np.flatnonzero(kept).tolist()])
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

    def _find_overconfidence(self, sessions: Integers, loops: Sequence[Edge]) -> Refusal | None:
        """Say by what factor odometry claims too much, if it refuses many loops that agree.

        Loops agree if they are believed together where odometry counts as little as its errors on
        the way between them ask for.
        """
        odometry = [edge for edge in self._edges if edge.kind == "odometry"]
        kept = [edge for edge in loops if self._edges[edge.number].state == "believed"]
        believed = len(kept)
        if len(loops) < _FEWEST_AGREEING or (
            believed >= _FEWEST_AGREEING and chi_ratio(self.poses, odometry, kept) <= _HONEST
        ):
            return None
        start, fixed, found = self._odometry_poses(), np.unique(sessions), MOST / _MARGIN
        for _ in range(2):
            scale = _MARGIN * found
            poses, refusals = self._solve_robustly(
                start, loops, self._gate(loops, scale), sessions, scale
            )
            agreeing = [edge for edge in loops if edge.number not in refusals]
            few = len(agreeing) < _FEWEST_AGREEING
            if few or believed > (1 - _MOST_REFUSED) * len(agreeing):
                return None
            found = fit_scale(poses, odometry, agreeing, fixed, scale)
            if found >= MOST:
                return None
        return Refusal(
            "overconfident-odometry",
            found,
            f"odometry contradicts {len(agreeing) - believed} of {len(agreeing)} loops that agree "
            f"with each other: its stated deviations are too small by a factor of {found:.2g}, or "
            "these loops are false",
        )
