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

from fusionslam._core import ExperienceMap as CoreMap
from fusionslam._core import ExperienceMapConfig as CoreMapConfig
from fusionslam.config import Section, core_section, merged
from fusionslam.errors import DataError
from fusionslam.evaluation.maps.run import LINK
from fusionslam.ratslam.actions import Action
from fusionslam.storage.arrays import Floats

STATE_VERSION = 1

if TYPE_CHECKING:

    class ExperienceMapConfig(Section):
        @property
        def preset(self) -> str: ...
else:
    ExperienceMapConfig = core_section("ExperienceMapConfig", CoreMapConfig)
    ExperienceMapConfig.__doc__ = "How the map is corrected, and which loops it believes."
__all__ = ["LINK", "ExperienceMap", "ExperienceMapConfig", "LoopCheck", "Relaxation", "Route"]


class Route(NamedTuple):
    """A way over a map: ids of the nodes, both ends among them, and how long it takes."""

    ids: list[int]
    seconds: float


class LoopCheck(NamedTuple):
    """Whether a loop fits odometry.

    Attributes:
        accepted: whether to make the link.
        error_m, error_rad: from where the map has the robot to where the loop puts it, metres and
            radians.
        allowed_m, allowed_rad: what drift since the target allows, metres along the error and
            radians.
        reason: why, in words.
    """

    accepted: bool
    error_m: float
    error_rad: float
    allowed_m: float
    allowed_rad: float
    reason: str


class Relaxation(NamedTuple):
    """What a relaxation did.

    Attributes:
        residual_m, residual_rad: root mean squares of the links' errors of place and of rotation,
            metres and radians.
        step_m: farthest move of a node in the last step, metres.
        sweeps: sweeps (openratslam), or Gauss-Newton steps (robust).
        nodes: nodes in the largest part that was solved.
        settled: nothing is left for later actions.
    """

    residual_m: float
    residual_rad: float
    step_m: float
    sweeps: int
    nodes: int
    settled: bool


class ExperienceMap:
    """Places, links between them, and where the robot is on the map.

    The ``openratslam`` preset does what the reference does: every loop is closed, and relaxation
    is a number of sweeps. The ``robust`` one, the default, weights each link by the drift that is
    to be expected on it (``drift_m``, ``drift_turn``, ``drift_heading``: random walks, so that
    variances add up along the way; ``place_m``, ``place_rad`` for views), solves for places and
    headings together, and believes loops only after ``check``.

    Args:
        config: None for the defaults.
        changes: values of the configuration that differ from it.

    Raises:
        ConfigError: an unknown key, or a value out of range.
    """

    def __init__(self, config: ExperienceMapConfig | None = None, **changes: Any) -> None:
        self.config = merged(config or ExperienceMapConfig(), changes)
        self._map = CoreMap(CoreMapConfig(**self.config.model_dump()))

    @property
    def nodes(self) -> Floats:
        """float64 (n, 3): x, y in metres and heading in radians of each node: a copy."""
        return self._map.nodes

    @property
    def links(self) -> NDArray[np.void]:
        """The links in the order of their making, dtype ``LINK``: a copy."""
        return self._map.links

    @property
    def current(self) -> int:
        """Id of the node that the robot was at last; 0 before the first one."""
        return self._map.current

    @property
    def pose(self) -> tuple[float, float, float]:
        """Where the robot is on the map: x, y in metres, heading in radians."""
        return self._map.pose

    @property
    def offset(self) -> tuple[float, float, float]:
        """The pose in the frame of the current node: metres forward and to the left, radians."""
        return self._map.offset

    def __len__(self) -> int:
        """The number of nodes."""
        return len(self._map)

    def on_odometry(self, v: float, w: float, dt: float) -> None:
        """Move on from the current node: metres and radians a second, seconds.

        Raises:
            DataError: a value that is not finite, or a negative time; nothing has moved.
        """
        self._map.on_odometry(v, w, dt)

    def check(self, action: Action) -> LoopCheck:
        """Whether a loop fits odometry: to be asked before ``apply``.

        The loop puts the robot somewhere in the target's frame; links and odometry since the
        target put it elsewhere. Of that difference, drift along the way of least drift allows
        ``sigmas`` deviations. A loop beyond it is refused, and remembered: once ``agreeing`` loops
        at different places, this one counted, claim one and the same shift between map and
        odometry of no more than ``agreed_sigmas`` deviations, the last of them is accepted, and
        ``apply`` links the earlier ones too. So
        nobody needs to ask again about a refused loop; what was done in its stead (a new node of
        the same view) stays, and ends up in the right place.

        Asking twice changes nothing. What is no loop is accepted.

        Raises:
            DataError: an unknown target, a source that is not the current node, or a rotation or
                place that is not finite.
        """
        return LoopCheck(*self._map.check(*_plain(action)))

    def apply(self, action: Action) -> None:
        """Do what the pose cells say.

        A new node lies where the robot is. An edge (robust) leads from the current node to the
        target: odometry, less where the view has the robot in the target's frame
        (``relative_place``, ``relative_rotation``); the robot then stands there. A second edge
        between two nodes makes the link more certain. The reference makes none, and puts the robot
        onto the target.

        Raises:
            DataError: as ``check``; or a node to be created that is not the next one. The map is
                as it was.
        """
        self._map.apply(*_plain(action))

    def relax(self, *, whole: bool = False) -> Relaxation:
        """Move nodes until links fit better.

        ``openratslam``: ``loops`` sweeps over all links. ``robust``: Gauss-Newton steps on the sum
        of squared errors, weighted by drift, of the nodes round new loops, wider and wider until
        what lies beside is at rest or ``work`` is used up. Work that was not needed is saved up;
        as soon as it suffices, the whole map is solved.

        Args:
            whole: solve the whole map now (robust), until no node moves by ``tolerance``.
        """
        return Relaxation(*self._map.relax(whole))

    def path(self, a: int, b: int) -> Route:
        """The quickest way from one node to another along links, in either direction.

        Raises:
            DataError: an unknown node, or two that no links join.
        """
        return quickest_route(self.links, len(self), a, b)

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything but the configuration, as arrays that ``restore`` takes."""
        return {"version": np.array([STATE_VERSION]), **self._map.state()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from a state, bit for bit; the configuration stays.

        Raises:
            DataError: another version, or arrays that no map can have; the map is as it was.
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
    """The quickest way from node a to node b along links, in either direction (Dijkstra 1959).

    Args:
        links: of dtype ``LINK``.
        count: how many nodes there are.
        a, b: ids.

    Raises:
        DataError: a node that there is not, or two that no links join.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    for node in (a, b):
        if not isinstance(node, SupportsIndex) or not 0 <= node < count:
            raise DataError(f"path from node {a} to node {b}: there are {count} nodes")
    ends = np.sort(np.stack([links["source"], links["target"]], axis=1), axis=1)
    # The quickest first: a matrix adds up what stands in it twice.
    order = np.lexsort((links["duration"], ends[:, 1], ends[:, 0]))
    pairs, first = np.unique(ends[order], axis=0, return_index=True)
    # A link that takes no time is one all the same, and an entry of 0 would be none.
    seconds = np.maximum(links["duration"][order][first], np.finfo(np.float64).tiny)
    graph = csr_array((seconds, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    took, before = dijkstra(graph, directed=False, indices=a, return_predecessors=True)
    if not np.isfinite(took[b]):
        raise DataError(f"path from node {a} to node {b}: no links join them")
    ids = [b]
    while ids[-1] != a:
        ids.append(int(before[ids[-1]]))
    return Route(ids[::-1], float(took[b]))
