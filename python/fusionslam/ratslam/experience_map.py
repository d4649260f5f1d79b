# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``ExperienceMap``: the graph of places that a robot has been to (Milford 2004, Ball 2013).

>>> graph = ExperienceMap()
>>> graph.apply(Action(ActionKind.CREATE_NODE))
>>> graph.on_odometry(1.0, 0.0, 0.5)
>>> graph.apply(Action(ActionKind.CREATE_NODE, 0, 1))
>>> graph.path(1, 0)
Route(ids=[1, 0], seconds=0.5)
"""

import operator
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import ActionKind
from fusionslam._core import ExperienceMap as CoreMap
from fusionslam._core import ExperienceMapConfig as CoreMapConfig
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats
from fusionslam.base.texts import counted
from fusionslam.config import Section, core_section, merged
from fusionslam.errors import DataError
from fusionslam.geometry.odometry_calibration import LoopCheck

STATE_VERSION = 1

if TYPE_CHECKING:

    class ExperienceMapConfig(Section):
        @property
        def preset(self) -> str: ...
        @property
        def drift_turn(self) -> float: ...
        @property
        def drift_heading(self) -> float: ...
else:
    ExperienceMapConfig = core_section("ExperienceMapConfig", CoreMapConfig, __name__)
    ExperienceMapConfig.__doc__ = "Parameters of map correction and of the acceptance of loops."


class Action(NamedTuple):
    """A change of the experience map.

    Attributes:
        kind: nothing, a new node, or an edge to a known one.
        source: id of the experience that the robot was at; 0 before the first one.
        target: id of the experience that it is at now.
        relative_rotation: rotation of the robot relative to the target, radians, counter-clockwise.
        relative_place: position of the robot in the target's frame, metres, x forward and y to the
            left; (0, 0) if it was not measured.
    """

    kind: ActionKind
    source: int = 0
    target: int = 0
    relative_rotation: float = 0.0
    relative_place: tuple[float, float] = (0.0, 0.0)


class Route(NamedTuple):
    """A route on the map: node ids including both ends, and its duration."""

    ids: list[int]
    seconds: float


class Relaxation(NamedTuple):
    """The result of a relaxation.

    Attributes:
        residual_m, residual_rad: root mean square errors of the links in position and rotation,
            metres and radians.
        step_m: largest move of a node in the last step, metres.
        sweeps: number of sweeps (openratslam) or Gauss-Newton steps (robust).
        nodes: number of nodes in the largest part that was solved.
        settled: True if no work is left for later actions.
    """

    residual_m: float
    residual_rad: float
    step_m: float
    sweeps: int
    nodes: int
    settled: bool


@checked
class ExperienceMap:
    """A graph of places and links, and the robot's pose on it.

    The ``openratslam`` preset follows the reference: it closes every loop, and relaxes by a fixed
    number of sweeps. The ``robust`` preset, the default, weights each link by its expected drift
    (``drift_m``, ``drift_turn``, ``drift_heading``: random walks, so that variances add up along
    the path; ``place_m``, ``place_rad`` for views), solves for positions and headings together,
    and accepts loops only after ``check``. Threads may share a map.

    Args:
        config: None for the defaults.
        changes: configuration values to override.

    Raises:
        ConfigError: an unknown key, or a value out of range.
    """

    def __init__(self, config: ExperienceMapConfig | None = None, **changes: Any) -> None:
        self.config = merged(config or ExperienceMapConfig(), changes)
        self._map = CoreMap(CoreMapConfig(**self.config.model_dump()))

    def __getstate__(self) -> dict[str, Any]:
        return {"config": self.config, "state": self.state()}

    def __setstate__(self, stored: Mapping[str, Any]) -> None:
        ExperienceMap.__init__(self, stored["config"])
        self.restore(stored["state"])

    def __repr__(self) -> str:
        sizes = f"{counted(len(self.nodes), 'node')}, {counted(len(self.links), 'link')}"
        return f"<ExperienceMap {self.config.preset}: {sizes}>"

    @property
    def nodes(self) -> Floats:
        """A copy of the nodes, float64 (n, 3): x, y in metres and heading in radians."""
        return self._map.nodes

    @property
    def links(self) -> NDArray[np.void]:
        """A copy of the links in the order of creation, dtype ``LINK``."""
        return self._map.links

    @property
    def current(self) -> int:
        """Id of the node that the robot visited last; 0 before the first one."""
        return self._map.current

    @property
    def pose(self) -> tuple[float, float, float]:
        """The robot's pose on the map: x, y in metres, heading in radians."""
        return self._map.pose

    @property
    def offset(self) -> tuple[float, float, float]:
        """The robot's pose in the current node's frame: metres forward and left, radians."""
        return self._map.offset

    def __len__(self) -> int:
        """The number of nodes."""
        return len(self._map)

    def on_odometry(self, v: float, w: float, dt: float) -> None:
        """Move the robot by odometry: velocity in m/s and rad/s, duration in seconds.

        Raises:
            DataError: a value that is not finite, or a negative time; the pose is unchanged.
        """
        self._map.on_odometry(v, w, dt)

    def mark_interruption(self) -> None:
        """Note that odometry was interrupted, so that the robot may have been carried (``robust``).

        The next loop to a node from before that fits odometry ends the doubt. If the robot is
        elsewhere, ``rejoin`` loops at different places that agree with each other put it there.
        """
        self._map.mark_interruption()

    def rescale_odometry(self, way: float, turn: float) -> None:
        """Multiply the distances and turns that odometry has measured so far by factors.

        Raises:
            DataError: a factor that is not above 0 and finite; the map is unchanged.
        """
        self._map.rescale_odometry(way, turn)

    def set_odometry_deviations(self, way: float, turn: float) -> None:
        """Say how far odometry's distances and turns may be off as a whole.

        Args:
            way, turn: standard deviations of the factors; 0 by default.

        Raises:
            DataError: a value that is negative or not finite.
        """
        self._map.set_odometry_deviations(way, turn)

    @checked
    def check(self, action: Action) -> LoopCheck:
        """Check whether a loop fits odometry; call it before ``apply``.

        The loop gives the robot's pose in the target's frame; links and odometry since the target
        give another one. Drift along the path of least drift allows a difference of ``sigmas``
        deviations. A loop beyond that is refused, and remembered: once ``agreeing`` loops at
        different places, including this one, imply the same shift between map and odometry of at
        most ``agreed_sigmas`` deviations, the last of them is accepted, and ``apply`` links the
        earlier ones too. After an interruption of odometry (``mark_interruption``), ``rejoin``
        loops since then are enough, however far off. A refused loop need not be checked again: the
        new node of the same view that was made instead stays, and ends up in the right place.

        Checking twice changes nothing. An action that is not a loop is accepted.

        Raises:
            DataError: an unknown target, a source that is not the current node, or a rotation or
                place that is not finite.
        """
        return LoopCheck(*self._map.check(*_plain(action)))

    @checked
    def apply(self, action: Action) -> None:
        """Apply an action of the pose cells.

        A new node is created at the robot's pose. An edge (robust) links the current node to the
        target by odometry minus the robot's pose in the target's frame according to the view
        (``relative_place``, ``relative_rotation``); the robot is then put at that pose. An edge
        across an interruption that contradicts odometry first moves all nodes since then. A second
        edge between two nodes makes the link more certain. The reference makes no second edge, and
        puts the robot onto the target.

        Raises:
            DataError: as ``check``; or a new node whose id is not the next one. The map is
                unchanged.
        """
        self._map.apply(*_plain(action))

    def relax(self, *, whole: bool = False) -> Relaxation:
        """Move nodes until links fit better.

        ``openratslam``: ``loops`` sweeps over all links. ``robust``: Gauss-Newton steps on the sum
        of squared errors, weighted by drift, of the nodes around new loops. The region grows until
        its neighbours are at rest or ``work`` is used up. Unused work is saved up; once it
        suffices, the whole map is solved.

        Args:
            whole: solve the whole map now (robust), until no node moves by ``tolerance``.
        """
        return Relaxation(*self._map.relax(whole))

    @checked
    def path(self, a: int, b: int) -> Route:
        """The fastest route from one node to another along links, in either direction.

        Raises:
            DataError: an unknown node, or nodes that are not connected.
        """
        return quickest_route(self.links, len(self), a, b)

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything but the configuration, as arrays for ``restore``."""
        return {"version": np.array([STATE_VERSION]), **self._map.state()}

    @checked
    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Resume from a state, bit for bit; the configuration stays.

        Raises:
            DataError: another version, or invalid arrays; the map is unchanged.
        """
        version = np.ravel(state.get("version", ()))
        if version.shape != (1,) or version[0] != STATE_VERSION:
            raise DataError(
                f"state of an experience map: version {version}, expected {STATE_VERSION}"
            )
        self._map.restore({name: values for name, values in state.items() if name != "version"})


def _plain(action: Action) -> tuple[int, int, int, float, tuple[float, float]]:
    x, y = action.relative_place
    try:
        kind, source, target = map(operator.index, action[:3])
    except TypeError:
        raise DataError(f"action {tuple(action[:3])}: expected whole numbers") from None
    return kind, source, target, float(action.relative_rotation), (float(x), float(y))


def quickest_route(links: NDArray[np.void], count: int, a: int, b: int) -> Route:
    """The fastest route from node a to node b along links, in either direction (Dijkstra 1959).

    Args:
        links: of dtype ``LINK``.
        count: number of nodes.
        a, b: node ids.

    Raises:
        DataError: an unknown node, or nodes that are not connected.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    for node in (a, b):
        if not isinstance(node, SupportsIndex) or not 0 <= node < count:
            raise DataError(
                f"path from node {a} to node {b}: there are {count} nodes", code="unknown-node"
            )
    a, b = int(a), int(b)  # True would be a mask of the rows below
    ends = np.sort(np.stack([links["source"], links["target"]], axis=1), axis=1)
    # Keep only the fastest link of a pair: a sparse matrix would add up duplicates.
    order = np.lexsort((links["duration"], ends[:, 1], ends[:, 0]))
    pairs, first = np.unique(ends[order], axis=0, return_index=True)
    # An entry of 0 would mean no link, so links of zero duration get the smallest float.
    seconds = np.maximum(links["duration"][order][first], np.finfo(np.float64).tiny)
    graph = csr_array((seconds, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    took, before = dijkstra(graph, directed=False, indices=a, return_predecessors=True)
    if not np.isfinite(took[b]):
        raise DataError(
            f"path from node {a} to node {b}: no links join them", code="nodes-not-linked"
        )
    ids = [b]
    while ids[-1] != a:
        ids.append(int(before[ids[-1]]))
    return Route(ids[::-1], float(took[b]))
