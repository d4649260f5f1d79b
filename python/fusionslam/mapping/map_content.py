# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a map contains, but for clouds and vectors: sessions, keyframes, edges, and poses."""

import logging
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusionslam.base.arrays import Floats, Integers, Matrix
from fusionslam.base.texts import counted
from fusionslam.errors import ConfigError
from fusionslam.geometry.globe import MapOrigin
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.error_bounds import Bound, ErrorBounds
from fusionslam.mapping.map_file import MapFile, StoredKeyframe
from fusionslam.mapping.merges import FEWEST_MERGES
from fusionslam.mapping.pose_graph import PoseGraph
from fusionslam.mapping.satellites import Position
from fusionslam.mapping.window import fuse_step
from fusionslam.registration import Refusal

_GROWTH = 1.1
"""Keyframes, of those solved last, at which new loops ask for the next solution of all."""

logger = logging.getLogger(__name__)

StoredSolution = tuple[Integers, Floats, Integers]


@dataclass(frozen=True)
class Session:
    """A drive on a map.

    Attributes:
        name: of the session.
        keyframes: number of them.
        parts: numbers of the parts of the map that they belong to; poses of different parts have
            nothing to do with each other.
    """

    name: str
    keyframes: int
    parts: tuple[int, ...]


class MapContent:
    """What the file of a map contains, in memory. Rows of keyframes follow their numbers.

    Args:
        sessions: their numbers by name, in the order in which they began.
        keyframes: by number.
        edges: by number; their nodes are keyframes.
        solution: as ``MapFile.solution`` returns. Newer keyframes follow by their steps, as they
            did when they were added.
        positions: that satellites tell; their nodes are keyframes.
        origins: where on the globe the solution has parts, by their numbers.
        reason: what was wrong with the graph of that solution as a whole.

    Raises:
        ValueError: a keyframe's session is missing.
        KeyError: a keyframe of an edge is missing.

    Attributes:
        sessions, keyframes: as above.
        edges: by their numbers.
        row: row of a keyframe by its number.
        parts: number of the first keyframe in each one's part of the map.
        next_edge: number of a new edge.
        odometry: float64 (4, 4), odom_from_cloud, by number of the keyframe.
        stretches: number of the first keyframe of the stretch of odometry, by number of the
            keyframe; odometry of different stretches cannot be compared.
        reason: what was wrong with the graph as a whole when it was solved last.
        places: where on the globe parts of the map are, by their numbers, or why positions do not
            tell it, of the last solve.
        is_live: whether the poses are those of the graph, not of the file.
        unsaved: edges by number that are new, or whose state has changed, since ``saved``.
    """

    def __init__(
        self,
        sessions: dict[str, int],
        keyframes: Iterable[StoredKeyframe],
        edges: Iterable[Edge],
        solution: StoredSolution | None,
        positions: Iterable[Position] = (),
        origins: Mapping[int, MapOrigin] | None = None,
        reason: Refusal | None = None,
    ) -> None:
        self.sessions = sessions
        self.keyframes: list[StoredKeyframe] = []
        self.edges: dict[int, Edge] = {}
        self.row: dict[int, int] = {}
        self.odometry: dict[int, Matrix] = {}
        self.stretches: dict[int, int] = {}
        self.reason = self._saved_reason = reason
        self.places: dict[int, MapOrigin | Refusal] = {**(origins or {})}
        self._saved_origins = self.origins
        self._graph = PoseGraph()
        self._graph_numbers: list[int] = []  # of its edges, here
        self._poses: Floats | None = None  # None: those of the graph
        self.parts: list[int] = []
        self.next_edge = 0
        self._solved = 0  # keyframes in the last solution
        self._asked = self._crossing = 0  # loops across parts: in the last solution, and now
        self._has_new_loops = False  # since the last solution
        self._is_solution_saved = True
        self.unsaved: dict[int, Edge] = {}
        self._bounds: ErrorBounds | None = None
        for keyframe in keyframes:
            if keyframe.session not in sessions.values():
                raise ValueError(f"keyframe {keyframe.id}: session {keyframe.session} is missing")
            self._add_node(keyframe)
        for edge in edges:
            self._add_edge(edge)
        self.set_positions(positions)
        self._place(solution)
        if any(max(self.row[e.a], self.row[e.b]) >= self._solved for e in self.loops):
            self.solve()

    def __len__(self) -> int:
        """Number of keyframes."""
        return len(self.keyframes)

    @property
    def numbers(self) -> Integers:
        """int64 (n,): numbers of the keyframes, ascending."""
        return np.array([*self.row], np.int64)

    @property
    def loops(self) -> tuple[Edge, ...]:
        """Loops between keyframes; steps that were measured by the clouds of both are none."""
        return tuple(
            edge
            for edge in self.edges.values()
            if edge.kind != "odometry" and not self.is_step(edge)
        )

    @property
    def origins(self) -> dict[int, MapOrigin]:
        """Where on the globe parts of the map are, by their numbers; without unknown ones."""
        return {part: at for part, at in self.places.items() if isinstance(at, MapOrigin)}

    @property
    def origin(self) -> MapOrigin | None:
        """Where on the globe the first part of the map is; None if it is not known."""
        return self.origins.get(self.parts[0]) if self.parts else None

    @property
    def poses(self) -> Floats:
        """float64 (n, 4, 4): map_from_cloud of the keyframes, each in its part of the map."""
        if self._poses is None:
            self._poses = self._graph.poses
        return self._poses

    def list_sessions(self) -> tuple[Session, ...]:
        """The drives, in the order in which they began."""
        parts: dict[int, list[int]] = {number: [] for number in self.sessions.values()}
        for keyframe, part in zip(self.keyframes, self.parts, strict=True):
            parts[keyframe.session].append(part)
        return tuple(
            Session(name, len(parts[number]), tuple(sorted(set(parts[number]))))
            for name, number in self.sessions.items()
        )

    def describe(self, size: int) -> str:
        """Say what is in a map whose file has this size in bytes, a line for each session."""
        loops = self.loops
        count = Counter(each.state for each in loops)
        lines = [
            f"{each.name}: {counted(each.keyframes, 'keyframe')}"
            + (f" in {len(each.parts)} parts" if len(each.parts) > 1 else "")
            for each in self.list_sessions()
        ]
        lines.append(
            f"{counted(len(self), 'keyframe')} in {counted(len(set(self.parts)), 'part')}, "
            f"{counted(len(loops), 'loop')}: {count['believed']} believed, "
            f"{count['refused']} refused, {count['pending']} pending; {size / 1e6:.1f} MB, "
            f"{size / 1e3 / max(len(self), 1):.0f} kB a keyframe"
        )
        for part, origin in self.origins.items():
            what = "its origin" if part == self.parts[0] else f"that of part {part}"
            lines.append(f"{what} is at {origin}")
        if self.reason is not None:
            lines.append(str(self.reason))
        return "\n".join(lines)

    def find_session(self, name: str) -> int:
        """Return the number of a session.

        Raises:
            ConfigError: there is none of this name.
        """
        if name not in self.sessions:
            raise ConfigError(
                f"there is no session {name!r}: expected one of {', '.join(self.sessions)}",
                code="choice",
                fields=("session", name),
            )
        return self.sessions[name]

    def keyframes_of(self, session: int) -> list[StoredKeyframe]:
        """Return the keyframes of a session."""
        return [each for each in self.keyframes if each.session == session]

    def pose(self, keyframe: int) -> Matrix:
        """Return map_from_cloud, float64 (4, 4), of a keyframe in its part of the map."""
        row = self.row[keyframe]
        return self._graph.pose(row) if self._poses is None else self._poses[row]

    def bound(self, keyframe: int) -> Bound:
        """Return how sure the pose of a keyframe is at least."""
        if self._bounds is None:
            believed = self._believed(self.edges.values())
            self._bounds = ErrorBounds(set(self.parts), self.row, believed)
        return self._bounds[keyframe]

    def _believed(self, edges: Iterable[Edge]) -> list[Edge]:
        return [each for each in edges if each.state == "believed" and not self._is_across(each)]

    def poses_of(self, keyframes: Iterable[int]) -> Floats:
        """Return map_from_cloud, float64 (m, 4, 4), of keyframes."""
        return self.poses[[self.row[number] for number in keyframes]]

    def part(self, keyframe: int) -> int:
        """Return the number of the first keyframe in a keyframe's part of the map."""
        return self.parts[self.row[keyframe]]

    def first_part(self) -> list[int]:
        """Return the keyframes in the part of the map that began first, by their numbers."""
        return [
            each.id
            for each, part in zip(self.keyframes, self.parts, strict=True)
            if part == self.parts[0]
        ]

    def near(self, place: Matrix, radius: float, keyframe: int) -> list[int]:
        """Return the keyframes this near to a pose in a keyframe's part, the nearest first."""
        parts = np.array(self.parts)
        apart = np.linalg.norm(self.poses[:, :3, 3] - place[:3, 3], axis=1)
        apart[parts != self.part(keyframe)] = np.inf
        order = np.argsort(apart, kind="stable")
        return [self.keyframes[row].id for row in order if apart[row] <= radius]

    def add(self, keyframe: StoredKeyframe, edges: Sequence[Edge]) -> None:
        """Add a keyframe, and edges to it; that of odometry comes first.

        The work does not grow with the map, but for a solution of the whole: when loops were found
        and the map has grown by a tenth since the last one, and when loops across parts may join
        these.
        """
        if not self.is_live:
            self.solve()
        self._add_node(keyframe)
        for edge in edges:
            self._add_edge(edge)
            self.unsaved[edge.number] = edge
        is_led = bool(edges) and edges[0].kind == "odometry"
        self.parts.append(self.part(edges[0].a) if is_led else keyframe.id)
        for edge in self._graph.update().edges:
            self._take_state(edge)
        if self._bounds is not None:
            self._bounds.add(keyframe.id, self._believed(self.edges[e.number] for e in edges))
        self._poses = None
        loops = [edge for edge in edges if edge.kind != "odometry" and not self.is_step(edge)]
        self._has_new_loops |= bool(loops)
        self._crossing += sum(self._is_across(edge) for edge in loops)
        has_grown = self._has_new_loops and len(self) >= _GROWTH * self._solved
        if has_grown or self._crossing >= max(FEWEST_MERGES, _GROWTH * self._asked):
            self.solve()

    def set_positions(self, positions: Iterable[Position]) -> None:
        """Take positions that satellites tell instead of those it had; the next solve uses them."""
        self._graph.set_positions([replace(each, node=self.row[each.node]) for each in positions])

    def solve(self) -> None:
        """Solve the graph."""
        before = self.parts, [edge.state for edge in self.edges.values()]
        solution = self._graph.solve()
        if solution.reason is not None and self.reason is None:
            logger.warning("%s", solution.reason)
        self.reason = solution.reason
        self._poses = solution.poses
        self.parts = [self.keyframes[int(node)].id for node in solution.parts]
        self.places = {self.keyframes[node].id: at for node, at in solution.places.items()}
        for edge in (*solution.believed, *solution.refused, *solution.pending):
            self._take_state(edge)
        if before != (self.parts, [edge.state for edge in self.edges.values()]):
            self._bounds = None
        self.is_live, self._has_new_loops, self._is_solution_saved = True, False, False
        self._solved = len(self)
        self._asked = self._crossing = sum(self._is_across(edge) for edge in self.edges.values())

    def take(self, measured: Iterable[Edge]) -> None:
        """Take edges, by their numbers, as they were measured anew, and solve the graph."""
        self.unsaved |= {edge.number: edge for edge in measured}
        positions = self._graph.positions
        self._graph, self._graph_numbers, self._bounds = PoseGraph(), [], None
        for keyframe in self.keyframes:
            self._graph.add_node(keyframe.robot_from_cloud)
        for edge in (self.edges | self.unsaved).values():
            self._add_edge(edge)
        self._graph.set_positions(positions)
        self.solve()

    def solve_new_loops(self) -> bool:
        """Solve the graph if loops came since its last solution; return whether they did.

        Poses are those then that the file gives once it is opened anew.
        """
        if self._has_new_loops:
            self.solve()
            return True
        return False

    def save(self, file: MapFile) -> None:
        """Write what is not in the file yet, but for keyframes."""
        for edge in self.unsaved.values():
            file.store_edge(edge)
        if not self._is_solution_saved:
            file.store_solution(self.numbers, self.poses, np.array(self.parts, np.int64))
        if self.origins != self._saved_origins:
            file.store_origins(self.origins)
        if self.reason != self._saved_reason:
            file.store_reason(self.reason)

    def saved(self) -> None:
        """Take note that the file has everything."""
        self.unsaved.clear()
        self._is_solution_saved = True
        self._saved_origins, self._saved_reason = self.origins, self.reason

    def _is_across(self, edge: Edge) -> bool:
        return self.part(edge.a) != self.part(edge.b)

    def _take_state(self, solved: Edge) -> None:
        """Take over the state of an edge of the graph."""
        number = self._graph_numbers[solved.number]
        known = self.edges[number]
        if known.state != solved.state or known.reason != solved.reason:
            changed = replace(known, state=solved.state, reason=solved.reason)
            self.edges[number] = self.unsaved[number] = changed

    def _add_node(self, keyframe: StoredKeyframe) -> None:
        self.row[keyframe.id] = len(self.keyframes)
        self.keyframes.append(keyframe)
        self.odometry[keyframe.id] = keyframe.odometry
        self.stretches[keyframe.id] = keyframe.id
        self._graph.add_node(keyframe.robot_from_cloud)

    def _add_edge(self, edge: Edge) -> None:
        a, b = self.row[edge.a], self.row[edge.b]
        by_hand = edge.reason if edge.is_by_hand else None
        self._graph.add_edge(a, b, edge.pose, edge.covariance, edge.kind, by_hand)
        self._graph_numbers.append(edge.number)
        self.edges[edge.number] = edge
        self.next_edge = max(self.next_edge, edge.number + 1)
        if edge.kind == "odometry":
            self.stretches[edge.b] = self.stretches[edge.a]

    def is_step(self, edge: Edge) -> bool:
        """Whether an edge measures the way from one keyframe to the next."""
        is_next = self.row[edge.b] - self.row[edge.a] == 1
        return is_next and self.stretches[edge.a] == self.stretches[edge.b]

    def _place(self, solution: StoredSolution | None) -> None:
        """Take poses of the last solution, and those of newer keyframes by their steps."""
        placed: list[Matrix] = []
        if solution is not None and np.array_equal(self.numbers[: len(solution[0])], solution[0]):
            placed, self.parts = [*solution[1]], solution[2].tolist()
        self._solved = len(placed)
        before = {edge.b: edge for edge in self.edges.values() if edge.kind == "odometry"}
        measured = {
            edge.b: edge
            for edge in self.edges.values()
            if edge.kind != "odometry" and edge.state != "refused" and self.is_step(edge)
        }
        for keyframe in self.keyframes[self._solved :]:
            step = before.get(keyframe.id)
            if step is None:
                placed.append(keyframe.robot_from_cloud)
                self.parts.append(keyframe.id)
            else:
                moved = step.pose
                if keyframe.id in measured:  # as while it was added
                    moved = fuse_step(moved, step.covariance, measured[keyframe.id])
                placed.append(placed[self.row[step.a]] @ moved)
                self.parts.append(self.part(step.a))
        self._poses = np.array(placed, np.float64).reshape(-1, 4, 4)
        self.is_live = not placed  # whether the graph's poses are these


def robot_poses(keyframes: Sequence[StoredKeyframe], poses: Iterable[Matrix]) -> Floats:
    """float64 (n, 4, 4): poses of the robot, of those of keyframes' clouds."""
    pairs = zip(keyframes, poses, strict=True)
    moved = [pose @ np.linalg.inv(each.robot_from_cloud) for each, pose in pairs]
    return np.array(moved, np.float64).reshape(-1, 4, 4)
