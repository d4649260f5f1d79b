# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``OdometryCalibration``: learns how much too long odometry's distances and turns are.

``LoopCheck`` says how a loop fits odometry.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import DataError
from fusionslam.geometry.se2 import relative_to, wrap

Place = tuple[float, float, float]
"""x, y in metres and heading in radians."""

_PRIOR = 0.03
"""Standard deviation of the factors of odometry that nobody has calibrated."""
_NEAR_M = 4.0
"""Metres of driving over which distances are compared: over longer ways, the heading is unsure."""
_PLACE_M, _PLACE_RAD = 0.02, 0.005
"""Standard deviations of a measured position and heading."""
_OFF_M, _OFF_SHARE = 0.1, 0.05
"""A measured position that is farther off than this, and this share of the way, is wrong."""
_ALIKE_M = 0.3
"""Views that are seen within so many metres err alike."""
_SURE = 1.5
"""A factor counts if it differs from 1 by more than so many standard deviations."""
_STEP = 0.002
"""Change of a factor from which on it is applied."""


class Factors(NamedTuple):
    """Factors on the distances and turns of odometry."""

    way: float = 1.0
    turn: float = 1.0


class _Track(NamedTuple):
    """Dead reckoning: the pose (heading not wrapped), metres driven, variance of the heading."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    way: float = 0.0
    variance: float = 0.0


class LoopCheck(NamedTuple):
    """The result of checking a loop against odometry.

    Attributes:
        accepted: whether to make the link.
        error_m, error_rad: offset from the robot's pose on the map to the pose by the loop, metres
            and radians.
        allowed_m, allowed_rad: the offset that drift since the target allows, metres along the
            error and radians.
        reason: the reason, in words.
    """

    accepted: bool
    error_m: float
    error_rad: float
    allowed_m: float
    allowed_rad: float
    reason: str

    @property
    def fits(self) -> bool:
        """Whether the offset is allowed, whatever else decided."""
        return self.error_m <= self.allowed_m and self.error_rad <= self.allowed_rad


class OdometryCalibration:
    """Compares odometry with the poses that recognised views measure.

    Distances are compared soon after a view was stored; turns over loops of any length, too, where
    a small error of each turn adds up. Both are least squares with a prior about 1.

    Args:
        drift_turn: standard deviation of the heading after a turn of one radian, rad/sqrt(rad).
        drift_heading: that after one metre, rad/sqrt(m).

    Attributes:
        factors: what to multiply odometry by.
    """

    def __init__(self, drift_turn: float, drift_heading: float) -> None:
        self.factors = Factors()
        self._drift = drift_turn, drift_heading
        self._track = _Track()
        self._stored: list[_Track] = []
        self._seen_way = 0.0
        # Information and information times error; first of the ways, then of the turns.
        self._sums = np.zeros((2, 2))

    @property
    def deviations(self) -> Factors:
        """Standard deviations of what the factors may still be off by."""
        return Factors(*((self._sums[:, 0] + _PRIOR**-2) ** -0.5).tolist())

    def __len__(self) -> int:
        """Number of views stored now."""
        return len(self._stored)

    def move(self, way: float, turn: float) -> None:
        """Follow odometry: turn by so many radians, then go so many metres."""
        x, y, heading, driven, variance = self._track
        heading += turn
        variance += self._drift[0] ** 2 * abs(turn) + self._drift[1] ** 2 * abs(way)
        x, y = x + way * math.cos(heading), y + way * math.sin(heading)
        self._track = _Track(x, y, heading, driven + abs(way), variance)

    def store(self) -> None:
        """Note that a view was stored here."""
        self._stored.append(self._track)

    def remove(self, number: int) -> None:
        """Forget a view; later ones move down by one."""
        del self._stored[number]

    def forget(self) -> None:
        """Note that odometry was interrupted: nothing is known of the way to views stored so far.

        What was learned stays.
        """
        self._stored = [track._replace(variance=-math.inf) for track in self._stored]

    def observe(self, views: Sequence[tuple[int, Place]]) -> Factors | None:
        """Learn from views that were recognised in one scan.

        Args:
            views: number of each, and the robot in its frame, as measured.

        Returns:
            By how much ``factors`` changed, if they did; None otherwise.
        """
        used = sum([self._observe_one(number, pose, len(views)) for number, pose in views])
        if not used:
            return None
        self._seen_way = self._track.way
        information = self._sums[:, 0] + _PRIOR**-2
        errors, deviations = self._sums[:, 1] / information, information**-0.5
        learned = np.where(np.abs(errors) > _SURE * deviations, 1 + errors, 1.0)
        before, now = np.array(self.factors), learned.clip(0.5, 2.0)
        if (np.abs(now / before - 1) < _STEP).all():
            return None
        self.factors = Factors(*now.tolist())
        return Factors(*(now / before).tolist())

    def _observe_one(self, number: int, pose: Place, count: int) -> bool:
        """Learn from one of some views; False if its pose cannot be right."""
        now, then = self._track, self._stored[number]
        since = now.way - then.way
        variance = _PLACE_RAD**2 + now.variance - then.variance
        if not math.isfinite(variance):
            return False
        # Views along one way share its errors, and so do those of one scan.
        news = min(1.0, (now.way - self._seen_way) / max(since, _ALIKE_M)) / count
        turn = now.heading - then.heading
        information, product = self._sums[1] + [_PRIOR**-2, 0.0]
        learned = product / information
        # Many turns in one direction add up to more than half a turn: only the rest is compared.
        rest = wrap(pose[2] - (1 + learned) * turn)
        allowed = 3 * math.sqrt(variance + turn * turn / information)
        if abs(rest) > allowed:
            return False
        if allowed < math.pi / 2:  # else it may be another rest
            error = learned * turn + rest
            self._sums[1] += news / variance * np.array([turn * turn, turn * error])
        if since > _NEAR_M:
            return True
        ahead, aside, _ = relative_to(then, now)
        off = pose[0] - ahead, pose[1] - aside
        if math.hypot(*off) <= _OFF_M + _OFF_SHARE * math.hypot(ahead, aside):
            values = [ahead * ahead + aside * aside, ahead * off[0] + aside * off[1]]
            self._sums[0] += news / _PLACE_M**2 * np.array(values)
        return True

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything that ``restore`` needs, as arrays."""
        rows = np.array([self._track, *self._stored], np.float64)
        return {
            "tracks": rows,
            "factors": np.array(self.factors),
            "seen_way": np.array(self._seen_way),
            "sums": self._sums.copy(),
        }

    def restore(self, state: Mapping[str, NDArray[Any]], stored: int) -> None:
        """Resume from a state.

        Args:
            state: of ``state``.
            stored: number of stored views.

        Raises:
            DataError: the arrays are invalid.
        """
        shapes = {"tracks": (stored + 1, 5), "factors": (2,), "seen_way": (), "sums": (2, 2)}
        for name, shape in shapes.items():
            rows = state[name]
            if rows.dtype != np.float64 or rows.shape != shape:
                raise DataError(f"{name} of a calibration: {rows.dtype} {rows.shape}, not {shape}")
            known = rows[:, :4] if name == "tracks" else rows  # variances may be forgotten
            if not np.isfinite(known).all() or np.isnan(rows).any():
                raise DataError(f"{name} of a calibration: expected finite values")
        if (state["factors"] <= 0).any() or (state["sums"][:, 0] < 0).any():
            raise DataError("a calibration has a factor or information of 0 or less")
        if (state["tracks"][:, 4] == np.inf).any() or not np.isfinite(state["tracks"][0, 4]):
            raise DataError("a calibration has an infinite variance")
        track, *rows = state["tracks"].tolist()
        self._track, self._stored = _Track(*track), [_Track(*row) for row in rows]
        self.factors = Factors(*state["factors"].tolist())
        self._seen_way, self._sums = float(state["seen_way"]), state["sums"].copy()
