# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Weighs the stored views that a scan resembles by where odometry has the robot.

Where a building repeats itself, single scans cannot tell its places apart, but a robot drives. The
filter keeps the stored views as nodes of an ``ExperienceMap`` of its own, whose model of drift says
how far odometry may be off since each of them. Only relative motion counts.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import ActionKind, ExperienceMap, ExperienceMapConfig
from fusionslam.config import Section, option
from fusionslam.errors import DataError, ShapeError
from fusionslam.geometry.rigid import is_rigid
from fusionslam.geometry.se2 import compose, places_of, wrapped
from fusionslam.storage.arrays import Floats, Matrix
from fusionslam.views.comparison import Candidate

Place = tuple[float, float, float]
"""x, y in metres and heading in radians."""

_CERTAIN = 0.02
"""Scans alone are never more certain than this: where places look alike, half of those that claim
0.98 and more are wrong."""
_SAME_M, _SAME_RAD = 0.5, 0.3
"""Candidates whose poses of the robot are this near each other say the same."""
_BESIDE_M = 5.0
"""Metres by which the area of the robot is longer and wider than that of the stored views."""


_OF_THE_MAP = ("drift_m", "drift_turn", "drift_heading", "place_m", "place_rad", "sigmas")
"""Options that the experience map has, too."""


class PlaceFilterConfig(Section):
    """How candidates of a scan are weighed by odometry."""

    candidates: int = option(20, "stored views that are weighed for a scan", ge=1, le=10_000)
    least: float = option(
        0.05, "candidates that are less probable by their scans alone are left out", ge=0, le=1
    )
    sigmas: float = option(
        3.0,
        "a pose this many standard deviations from where odometry has the robot is wrong",
        gt=0.1,
        le=10,
    )
    slide_share: float = option(
        0.5, "share of the wrong poses that are near the right one, as along a wall", ge=0, le=1
    )
    slide_m: float = option(1.0, "standard deviation of these", unit="m", gt=0)
    slide_rad: float = option(0.3, "standard deviation of their heading", unit="rad", gt=0)
    drift_m: float = option(
        0.03, "standard deviation of odometry's position after one metre", unit="m/sqrt(m)", gt=0
    )
    drift_turn: float = option(
        0.01,
        "standard deviation of its heading after a turn of one radian",
        unit="rad/sqrt(rad)",
        gt=0,
    )
    drift_heading: float = option(
        0.005, "standard deviation of its heading after one metre", unit="rad/sqrt(m)", gt=0
    )
    place_m: float = option(0.1, "standard deviation of an alignment's position", unit="m", gt=0)
    place_rad: float = option(0.05, "standard deviation of its heading", unit="rad", gt=0)
    max_step: float = option(
        5.0, "odometry that moves farther between two scans has jumped", unit="m", gt=0
    )


@dataclass(frozen=True)
class Belief:
    """What a scan and odometry say together.

    Attributes:
        best: the candidate that is matched if the place is known; None without candidates.
        known: probability that the place is that of ``best``.
        new: probability that no candidate is right.
        shares: slots of the candidates and the probability of each, most probable first.
    """

    best: Candidate | None
    known: float
    new: float
    shares: tuple[tuple[int, float], ...] = ()


class _Weight(NamedTuple):
    """A candidate, its odds against a new place, and whether odometry or other loops confirm it."""

    candidate: Candidate
    odds: float
    is_confirmed: bool


class PlaceFilter:
    """A belief over the stored views, moved by odometry.

    Args:
        config: None for the defaults.
    """

    def __init__(self, config: PlaceFilterConfig | None = None) -> None:
        self.config = config or PlaceFilterConfig()
        values = {name: getattr(self.config, name) for name in _OF_THE_MAP}
        self._map = ExperienceMap(ExperienceMapConfig(**values))
        self._nodes: list[int] = []
        self._last: Place | None = None
        self._lost_since: int | None = None

    @property
    def is_lost(self) -> bool:
        """Whether odometry was interrupted, and no view from before was matched since."""
        return self._lost_since is not None

    def move(self, odometry: Matrix | None) -> None:
        """Move the robot to where odometry has it now.

        Args:
            odometry: float64 (4, 4), odom_from_robot; None if it is unknown, so that the robot may
                be anywhere.

        Raises:
            ShapeError: it is not (4, 4). DataError: it is no rigid motion (code "not-a-rotation").
        """
        here = None if odometry is None else _ground(odometry)
        before, self._last = self._last, here
        if before is None or here is None:
            self._interrupt()
            return
        x, y = here[0] - before[0], here[1] - before[1]
        way, turn = math.hypot(x, y), _wrap(here[2] - before[2])
        if way > self.config.max_step:
            self._interrupt()
            return
        bearing = _wrap(math.atan2(y, x) - before[2]) if way else 0.0
        if abs(bearing) > math.pi / 2:  # backwards
            way, bearing = -way, bearing - math.copysign(math.pi, bearing)
        for v, w in ((0.0, bearing), (way, 0.0), (0.0, turn - bearing)):
            self._map.on_odometry(v, w, 1.0)

    def _interrupt(self) -> None:
        self._map.mark_interruption()
        # A second time it may still be where it was lost first.
        if self._lost_since is None and len(self._map):
            self._lost_since = len(self._map)

    def weigh(self, candidates: Sequence[Candidate]) -> Belief:
        """Weigh candidates by where odometry has the robot.

        Args:
            candidates: with ``relative_pose``, and the probability as ``similarity``.
        """
        nodes = self._map.nodes
        weights, stored, seen = [], [], []
        for one in candidates:
            if one.similarity >= self.config.least and one.relative_pose is not None:
                weights.append(self._weigh_one(one, one.relative_pose, nodes))
                stored.append(nodes[self._nodes[one.slot]])
                seen.append(one.relative_pose)
        if not weights:
            return Belief(None, 0.0, 1.0)
        odds = np.array([each.odds for each in weights])
        total, best = 1.0 + float(odds.sum()), int(odds.argmax())
        poses = compose(np.array(stored), np.array(seen))
        apart = poses - poses[best]
        same = np.hypot(apart[:, 0], apart[:, 1]) < _SAME_M
        same &= np.abs(wrapped(apart[:, 2])) < _SAME_RAD
        known = float(odds[same].sum()) / total if weights[best].is_confirmed else 0.0
        shares = [(each.candidate.slot, each.odds / total) for each in weights]
        shares.sort(key=lambda share: (-share[1], share[0]))
        return Belief(weights[best].candidate, known, 1.0 / total, tuple(shares))

    def _weigh_one(self, candidate: Candidate, pose: Place, nodes: Floats) -> "_Weight":
        """The odds of a candidate against a new place.

        Bayes: those of the scans times the density of the pose if it is right, by that if it is
        wrong. Wrong ones slide along the right one, or are anywhere on the map.
        """
        config = self.config
        check = self._check(candidate.slot, pose)
        accepted, error_m, error_rad, allowed_m, allowed_rad, _ = check
        probability = min(candidate.similarity, 1 - _CERTAIN)
        by_scans = probability / (1 - probability)
        if self._lost_since is not None and self._nodes[candidate.slot] < self._lost_since:
            return _Weight(candidate, by_scans, accepted)  # odometry says nothing of it
        if error_m > allowed_m or error_rad > allowed_rad:
            return _Weight(candidate, by_scans if accepted else 0.0, accepted)
        sd_m, sd_rad = allowed_m / config.sigmas, allowed_rad / config.sigmas
        right = _density(error_m, error_rad, sd_m, sd_rad)
        sliding = _density(
            error_m,
            error_rad,
            math.hypot(sd_m, config.slide_m),
            math.hypot(sd_rad, config.slide_rad),
        )
        sides = np.ptp(nodes[:, :2], axis=0) + _BESIDE_M
        anywhere = 1 / (float(sides.prod()) * 2 * math.pi)
        share = config.slide_share
        odds = by_scans * right / (share * sliding + (1 - share) * anywhere)
        return _Weight(candidate, float(odds), True)

    def _check(self, slot: int, pose: Place) -> tuple[bool, float, float, float, float, str]:
        action = (ActionKind.CREATE_EDGE, self._map.current, self._nodes[slot], pose[2], pose[:2])
        found: tuple[bool, float, float, float, float, str] = self._map.check(*action)
        return found

    def arrive(self, candidate: Candidate) -> None:
        """Put the robot where a match says, and let the map give way."""
        pose = candidate.relative_pose
        assert pose is not None
        target = self._nodes[candidate.slot]
        self._map.apply(ActionKind.CREATE_EDGE, self._map.current, target, pose[2], pose[:2])
        self._map.relax(False)
        if self._lost_since is not None and target < self._lost_since:
            self._lost_since = None

    def store(self) -> None:
        """Store where the robot is as the place of a new view."""
        self._nodes.append(len(self._map))
        self.pass_by()

    def pass_by(self) -> None:
        """Note where the robot is, without a view."""
        number = len(self._map)
        self._map.apply(ActionKind.CREATE_NODE, self._map.current, number, 0.0, (0.0, 0.0))
        self._map.relax(False)

    def remove(self, slot: int) -> None:
        """Forget which node a stored view has; the node stays."""
        del self._nodes[slot]

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything but the configuration, as arrays for ``restore``."""
        last = () if self._last is None else self._last
        lost = [] if self._lost_since is None else [self._lost_since]
        own = {
            "nodes_of_slots": np.array(self._nodes, np.int64),
            "last": np.array(last, float),
            "lost_since": np.array(lost, np.int64),
        }
        return own | {f"map.{name}": values for name, values in self._map.state().items()}

    def restore(self, state: Mapping[str, NDArray[Any]], slots: int) -> None:
        """Go on from a state.

        Args:
            state: of ``state``.
            slots: number of stored views.

        Raises:
            DataError: the arrays are invalid.
        """
        start = "map."
        self._map.restore({k.removeprefix(start): v for k, v in state.items() if k[:4] == start})
        nodes, last, lost = (state[name] for name in ("nodes_of_slots", "last", "lost_since"))
        valid = nodes.dtype == np.int64 and nodes.shape == (slots,)
        if not valid or not ((nodes >= 0) & (nodes < len(self._map))).all():
            raise DataError(f"{slots} views, but nodes {nodes.dtype} {nodes.shape} of a filter")
        if lost.dtype != np.int64 or lost.shape not in ((0,), (1,)) or (lost < 1).any():
            raise DataError(f"lost_since {lost.dtype} {lost.shape} of a filter: expected a node")
        if last.shape not in ((0,), (3,)) or not np.isfinite(last).all():
            raise DataError(f"last pose {last.tolist()} of a filter: expected x, y and heading")
        self._nodes = nodes.tolist()
        self._lost_since = int(lost[0]) if lost.size else None
        x, y, heading = last.tolist() or (0.0, 0.0, 0.0)
        self._last = (x, y, heading) if last.size else None


def _ground(pose: Matrix) -> Place:
    """x, y and heading of odom_from_robot."""
    matrix = np.asarray(pose)
    if matrix.shape != (4, 4) or matrix.dtype.kind not in "fiu":
        raise ShapeError(
            f"odometry: {matrix.dtype} {matrix.shape}, expected numbers (4, 4)",
            fields=("odometry",),
        )
    if not np.isfinite(matrix).all() or not is_rigid(matrix):
        raise DataError(
            f"odometry is no rotation and translation: {matrix.tolist()}",
            code="not-a-rotation",
            fields=("odometry",),
        )
    x, y, heading = places_of(matrix[None].astype(np.float64))[0].tolist()
    return x, y, heading


def _wrap(angle: float) -> float:
    return float(wrapped(np.asarray(angle)))


def _density(error_m: float, error_rad: float, sd_m: float, sd_rad: float) -> float:
    """Of a normal distribution over positions and headings, per square metre and radian."""
    square = (error_m / sd_m) ** 2 + (error_rad / sd_rad) ** 2
    return math.exp(-square / 2) / (math.tau * math.sqrt(math.tau) * sd_m**2 * sd_rad)
