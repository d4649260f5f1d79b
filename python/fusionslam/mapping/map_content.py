# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a map contains, but for clouds and vectors: sessions, keyframes, edges, and poses."""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fusionslam.errors import ConfigError
from fusionslam.mapping.edge import Edge
from fusionslam.mapping.map_file import StoredKeyframe
from fusionslam.mapping.pose_graph import PoseGraph
from fusionslam.registration import Refusal
from fusionslam.storage.arrays import Floats, Integers, Matrix

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
        solution: as ``MapFile.solution`` returns. Newer keyframes follow by odometry.

    Raises:
        ValueError: a keyframe's session is missing.
        KeyError: a keyframe of an edge is missing.

    Attributes:
        sessions, keyframes: as above.
        edges: by their numbers.
        row: row of a keyframe by its number.
        odometry: float64 (4, 4), odom_from_cloud, by number of the keyframe.
        stretches: number of the first keyframe of the stretch of odometry, by number of the
            keyframe; odometry of different stretches cannot be compared.
        reason: what was wrong with the graph as a whole when it was solved last.
    """

    def __init__(
        self,
        sessions: dict[str, int],
        keyframes: Iterable[StoredKeyframe],
        edges: Iterable[Edge],
        solution: StoredSolution | None,
    ) -> None:
        self.sessions = sessions
        self.keyframes: list[StoredKeyframe] = []
        self.edges: dict[int, Edge] = {}
        self.row: dict[int, int] = {}
        self.odometry: dict[int, Matrix] = {}
        self.stretches: dict[int, int] = {}
        self.reason: Refusal | None = None
        self._graph = PoseGraph()
        self._graph_numbers: list[int] = []  # of its edges, here
        self._poses: list[Matrix] = []
        self._parts: list[int] = []
        self._next_edge = 0
        for keyframe in keyframes:
            if keyframe.session not in sessions.values():
                raise ValueError(f"keyframe {keyframe.id}: session {keyframe.session} is missing")
            self._add_node(keyframe)
        for edge in edges:
            self._add_edge(edge)
        self._place(solution)

    def __len__(self) -> int:
        """Number of keyframes."""
        return len(self.keyframes)

    @property
    def numbers(self) -> Integers:
        """int64 (n,): numbers of the keyframes, ascending."""
        return np.array([*self.row], np.int64)

    @property
    def next_keyframe(self) -> int:
        """Number of a new keyframe."""
        return self.keyframes[-1].id + 1 if self.keyframes else 0

    @property
    def next_edge(self) -> int:
        """Number of a new edge."""
        return self._next_edge

    @property
    def loops(self) -> tuple[Edge, ...]:
        """Loops between keyframes; steps that were measured by the clouds of both are none."""
        return tuple(
            edge
            for edge in self.edges.values()
            if edge.kind != "odometry" and not self._is_step(edge)
        )

    @property
    def parts(self) -> Sequence[int]:
        """Number of the first keyframe in each one's part of the map."""
        return self._parts

    @property
    def solution(self) -> StoredSolution:
        """What the file keeps of poses."""
        return self.numbers, np.array(self._poses), np.array(self._parts, np.int64)

    def list_sessions(self) -> tuple[Session, ...]:
        """The drives, in the order in which they began."""
        parts: dict[int, list[int]] = {number: [] for number in self.sessions.values()}
        for keyframe, part in zip(self.keyframes, self._parts, strict=True):
            parts[keyframe.session].append(part)
        return tuple(
            Session(name, len(parts[number]), tuple(sorted(set(parts[number]))))
            for name, number in self.sessions.items()
        )

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
        return self._poses[self.row[keyframe]]

    def part(self, keyframe: int) -> int:
        """Return the number of the first keyframe in a keyframe's part of the map."""
        return self._parts[self.row[keyframe]]

    def is_of(self, keyframe: int, session: int) -> bool:
        """Whether a keyframe belongs to a session."""
        return self.keyframes[self.row[keyframe]].session == session

    def first_part(self) -> list[int]:
        """Return the keyframes in the part of the map that began first, by their numbers."""
        return [
            each.id
            for each, part in zip(self.keyframes, self._parts, strict=True)
            if part == self._parts[0]
        ]

    def near(self, place: Matrix, radius: float, keyframe: int) -> list[int]:
        """Return the keyframes this near to a pose in a keyframe's part, the nearest first."""
        parts = np.array(self._parts)
        apart = np.linalg.norm(np.array(self._poses)[:, :3, 3] - place[:3, 3], axis=1)
        apart[parts != self.part(keyframe)] = np.inf
        order = np.argsort(apart, kind="stable")
        return [self.keyframes[row].id for row in order if apart[row] <= radius]

    def add(self, keyframe: StoredKeyframe, edges: Sequence[Edge]) -> None:
        """Add a keyframe, and edges to it; that of odometry comes first."""
        self._add_node(keyframe)
        for edge in edges:
            self._add_edge(edge)
        is_led = bool(edges) and edges[0].kind == "odometry"
        self._append_pose(keyframe, edges[0] if is_led else None)

    def solve(self) -> list[Edge]:
        """Solve the graph; return the edges whose state has changed."""
        solution = self._graph.solve()
        if solution.reason is not None and self.reason is None:
            logger.warning("%s", solution.reason)
        self.reason = solution.reason
        self._poses = [*solution.poses]
        self._parts = [self.keyframes[int(node)].id for node in solution.parts]
        states = (*solution.believed, *solution.refused, *solution.pending)
        return [edge for each in states if (edge := self._take_state(each)) is not None]

    def _take_state(self, solved: Edge) -> Edge | None:
        """Take over the state of an edge of the graph; None if it has not changed."""
        number = self._graph_numbers[solved.number]
        known = self.edges[number]
        if known.state == solved.state and known.reason == solved.reason:
            return None
        self.edges[number] = replace(known, state=solved.state, reason=solved.reason)
        return self.edges[number]

    def _add_node(self, keyframe: StoredKeyframe) -> None:
        self.row[keyframe.id] = len(self.keyframes)
        self.keyframes.append(keyframe)
        self.odometry[keyframe.id] = keyframe.odometry
        self.stretches[keyframe.id] = keyframe.id
        self._graph.add_node(keyframe.robot_from_cloud)

    def _add_edge(self, edge: Edge) -> None:
        self.edges[edge.number] = edge
        self._next_edge = max(self._next_edge, edge.number + 1)
        if edge.kind == "odometry":
            self.stretches[edge.b] = self.stretches[edge.a]
        a, b = self.row[edge.a], self.row[edge.b]
        self._graph.add_edge(a, b, edge.pose, edge.covariance, edge.kind)
        self._graph_numbers.append(edge.number)

    def _is_step(self, edge: Edge) -> bool:
        is_next = self.row[edge.b] - self.row[edge.a] == 1
        return is_next and self.stretches[edge.a] == self.stretches[edge.b]

    def _place(self, solution: StoredSolution | None) -> None:
        """Take poses of the last solution, and those of newer keyframes by odometry."""
        if solution is not None:
            numbers, poses, parts = solution
            if np.array_equal(self.numbers[: len(numbers)], numbers):
                self._poses, self._parts = [*poses], parts.tolist()
        before = {edge.b: edge for edge in self.edges.values() if edge.kind == "odometry"}
        for keyframe in self.keyframes[len(self._poses) :]:
            self._append_pose(keyframe, before.get(keyframe.id))

    def _append_pose(self, keyframe: StoredKeyframe, step: Edge | None) -> None:
        if step is None:
            self._poses.append(keyframe.robot_from_cloud)
            self._parts.append(keyframe.id)
        else:
            self._poses.append(self.pose(step.a) @ step.pose)
            self._parts.append(self.part(step.a))


def robot_poses(keyframes: Sequence[StoredKeyframe], poses: Iterable[Matrix]) -> Floats:
    """float64 (n, 4, 4): poses of the robot, of those of keyframes' clouds."""
    pairs = zip(keyframes, poses, strict=True)
    moved = [pose @ np.linalg.inv(each.robot_from_cloud) for each, pose in pairs]
    return np.array(moved, np.float64).reshape(-1, 4, 4)
