# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``ExperienceMap``: the graph of places that a robot has been to (Milford 2004, Ball 2013)."""

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.config import Section, merged, option
from fusionslam.errors import DataError
from fusionslam.ratslam.actions import Action, ActionKind

Floats = NDArray[np.float64]

LINK = np.dtype(
    [
        ("source", np.int64),
        ("target", np.int64),
        ("distance", np.float64),
        ("heading", np.float64),
        ("facing", np.float64),
        ("duration", np.float64),
    ]
)
"""A link: ids; metres; direction of the way and rotation, radians from the source's heading;
seconds."""


class LoopCheck(NamedTuple):
    accepted: bool
    error_m: float
    error_rad: float
    allowed_m: float
    allowed_rad: float
    reason: str


class ExperienceMapConfig(Section):
    """How the map is corrected; the defaults are the reference run's."""

    preset: Literal["robust", "openratslam"] = option(
        "robust", "robust (ours) or openratslam (Ball et al. 2013, as its program behaves)"
    )
    loops: int = option(20, "sweeps of relaxation after an action", ge=0)
    correction: float = option(0.5, "part of a link's error that a sweep takes away", ge=0, le=0.5)
    initial_heading: float = option(0.0, "heading of the robot at the start", unit="rad")


class ExperienceMap:
    """Places, links between them, and where the robot is on the map.

    Args:
        config: None for the defaults.
        changes: values of the configuration that differ from it.

    Raises:
        ConfigError: an unknown key, or a value out of range.
    """

    def __init__(self, config: ExperienceMapConfig | None = None, **changes: Any) -> None:
        self.config = merged(config or ExperienceMapConfig(), changes)
        self._nodes: list[list[float]] = []
        self._links: list[tuple[int, int, float, float, float, float]] = []
        self._out: list[list[int]] = []
        self._current = 0
        self._dx = self._dy = 0.0
        self._facing = self.config.initial_heading
        self._seconds = 0.0

    @property
    def nodes(self) -> Floats:
        """float64 (n, 3): x, y in metres and heading in radians of each node: a copy."""
        return np.array(self._nodes, np.float64).reshape(-1, 3)

    @property
    def links(self) -> NDArray[np.void]:
        """The links in the order of their making, dtype ``LINK``: a copy."""
        return np.array(self._links, LINK)

    @property
    def current(self) -> int:
        """Id of the node that the robot was at last; 0 before the first one."""
        return self._current

    @property
    def pose(self) -> tuple[float, float, float]:
        """Where the robot is on the map: x, y in metres, heading in radians."""
        x, y = self._nodes[self._current][:2] if self._nodes else (0.0, 0.0)
        return x + self._dx, y + self._dy, self._facing

    @property
    def offset(self) -> tuple[float, float, float]:
        heading = self._nodes[self._current][2] if self._nodes else 0.0
        c, s = np.cos(heading), np.sin(heading)
        x, y = c * self._dx + s * self._dy, c * self._dy - s * self._dx
        return float(x), float(y), _angle(self._facing - heading)

    def check(self, action: Action) -> LoopCheck:
        return LoopCheck(True, 0.0, 0.0, 1.0, 1.0, "")

    def state(self) -> dict[str, NDArray[Any]]:
        return {
            "nodes": self.nodes,
            "links": self.links,
            "now": np.array([self._current, self._dx, self._dy, self._facing, self._seconds]),
        }

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        self._nodes = state["nodes"].tolist()
        self._links = [tuple(row) for row in state["links"].tolist()]
        self._out = [[] for _ in self._nodes]
        for number, link in enumerate(self._links):
            self._out[link[0]].append(number)
        current, self._dx, self._dy, self._facing, self._seconds = state["now"].tolist()
        self._current = int(current)

    def on_odometry(self, v: float, w: float, dt: float) -> None:
        """Move on from the current node: metres and radians a second, seconds."""
        self._facing = _angle(self._facing + w * dt)
        self._dx += v * dt * np.cos(self._facing)
        self._dy += v * dt * np.sin(self._facing)
        self._seconds += dt

    def apply(self, action: Action) -> None:
        """Do what the pose cells say.

        Raises:
            DataError: a node to be created that is not the next one, or an unknown one.
        """
        if action.kind == ActionKind.NONE:
            return
        if action.kind == ActionKind.CREATE_NODE:
            self._create_node(action)
        else:
            self._create_edge(action)

    def _create_node(self, action: Action) -> None:
        if action.target != len(self._nodes):
            raise DataError(f"node {action.target}: expected {len(self._nodes)}, the next one")
        x, y, heading = self.pose
        self._nodes.append([x, y, heading])
        self._out.append([])
        if action.target > 0:
            self._link(self._current, action.target, action.relative_rotation)
        # The reference does not start anew at its first node: the way to it counts twice.
        if action.target > 0 or self.config.preset == "robust":
            self._arrive(action.target, heading)

    def _create_edge(self, action: Action) -> None:
        if not 0 <= action.target < len(self._nodes):
            raise DataError(f"node {action.target}: there are {len(self._nodes)}")
        self._link(self._current, action.target, action.relative_rotation)
        self._arrive(
            action.target, _angle(self._nodes[action.target][2] + action.relative_rotation)
        )

    def _link(self, source: int, target: int, rotation: float) -> None:
        for one, other in ((source, target), (target, source)):
            if any(self._links[link][1] == other for link in self._out[one]):
                return
        heading = self._nodes[source][2]
        way = np.arctan2(self._dy, self._dx)
        link = (
            source,
            target,
            float(np.hypot(self._dx, self._dy)),
            _angle(way - heading),
            _angle(self._facing + rotation - heading),
            self._seconds,
        )
        self._out[source].append(len(self._links))
        self._links.append(link)

    def _arrive(self, node: int, facing: float) -> None:
        self._current, self._facing = node, facing
        self._dx = self._dy = 0.0
        if self.config.preset == "robust":
            self._seconds = 0.0

    def relax(self) -> None:
        """Move nodes until links fit better: ``loops`` sweeps over all of them."""
        for _ in range(self.config.loops):
            for source, links in enumerate(self._out):
                for link in links:
                    self._correct(source, link)

    def _correct(self, source: int, link: int) -> None:
        _, target, distance, heading, facing, _ = self._links[link]
        one, other = self._nodes[source], self._nodes[target]
        way = one[2] + heading
        dx = (other[0] - one[0] - distance * np.cos(way)) * self.config.correction
        dy = (other[1] - one[1] - distance * np.sin(way)) * self.config.correction
        one[0], one[1] = one[0] + dx, one[1] + dy
        other[0], other[1] = other[0] - dx, other[1] - dy
        turn = _angle(other[2] - one[2] - facing) * self.config.correction
        one[2], other[2] = _angle(one[2] + turn), _angle(other[2] - turn)


def _angle(value: float) -> float:
    """The same angle in (-pi, pi]."""
    wrapped = float(np.pi - (np.pi - value) % (2 * np.pi))
    return wrapped
