# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Finds a robot on a map that is known, from what it sees now and the motion since."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fusionslam.base.arrays import Matrix
from fusionslam.config import Section, option
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.contract import rule_of
from fusionslam.loop_closure.observation import Observation
from fusionslam.loop_closure.verification import PairComparisons, StoredFrame, verify_candidates
from fusionslam.mapping.edge import deviations_of
from fusionslam.mapping.map_content import MapContent
from fusionslam.registration import Refusal, register


class LocalizationConfig(Section):
    """When a pose on a map is believed."""

    # Keyframes beside each other are deceived together: in a street that looks like another one,
    # two agree on poses of 0.5 to 0.7. Right poses of towns are above 0.85.
    min_probability: float = option(
        0.8, "less probable poses are neither believed nor confirm others", ge=0, le=1
    )
    neighborhood: float = option(
        10.0, "keyframes this near confirm a pose", unit="m", gt=0, allow_inf_nan=False
    )
    confirmations: int = option(3, "keyframes asked for a second opinion", ge=1)
    memory: float = option(
        10.0, "poses of this time confirm each other by odometry", unit="s", ge=0
    )
    agreement: float = option(0.3, "agreeing poses are this near", unit="m", gt=0)
    angle_agreement: float = option(2.0, "agreeing poses are turned this little", unit="deg", gt=0)


@dataclass(frozen=True)
class Localization:
    """Where a robot is on a map.

    Attributes:
        map_from_robot: float64 (4, 4); None if it is not known.
        covariance: float64 (6, 6) of the pose's error against the keyframe, as a small motion in
            the robot's frame: x, y, z in metres and rotations in radians; None without a pose.
        keyframe: number of the keyframe that the pose was found by; of the best one that was not
            believed if there is a reason; None without any.
        reason: why there is no pose; None if there is one.
        part: of the map, whose frame the pose is in, as ``Session.parts`` numbers them; poses of
            different parts have nothing to do with each other. None without a pose.
        unconfirmed_m: metres by odometry since the robot was found last, or since it was looked for
            first: 0 with a pose; None without a pose if odometry does not tell it.
        is_lost: whether they are more than ``MapConfig.lost_after``, or there is neither a pose nor
            odometry.
    """

    map_from_robot: Matrix | None
    covariance: Matrix | None = None
    keyframe: int | None = None
    reason: Refusal | None = None
    part: int | None = None
    unconfirmed_m: float | None = None
    is_lost: bool = True

    @property
    def deviation_m(self) -> float | None:
        """Root mean square of the error of the position that is to be expected, metres."""
        return None if self.covariance is None else float(deviations_of(self.covariance)[0])

    @property
    def deviation_deg(self) -> float | None:
        """The same of the rotation, degrees."""
        return None if self.covariance is None else float(deviations_of(self.covariance)[1])

    @property
    def pose(self) -> Matrix | None:
        """``map_from_robot``."""
        return self.map_from_robot


class _Guess(NamedTuple):
    """A pose on the map by one keyframe, map_from_cloud."""

    pose: Matrix
    covariance: Matrix
    keyframe: int
    probability: float


class _Past(NamedTuple):
    """A pose of an earlier moment."""

    pose: Matrix
    odometry: Matrix
    stamp_ns: int | None
    keyframe: int
    part: int


class Localizer:
    """Finds a robot on a map: without any guess first, then by its motion.

    A pose counts if a second keyframe of the neighbourhood says the same, or if a pose of the last
    seconds, moved by odometry, does.

    Args:
        content: of the map.
        stored: returns a keyframe by its number.
        loops: which candidates are tried, and how often poses may be false (``false_rate``).
        lost_after: metres by odometry since the robot was found, after which it is lost.
        config: when a pose is believed.
    """

    def __init__(
        self,
        content: MapContent,
        stored: Callable[[int], StoredFrame],
        loops: LoopConfig | None = None,
        lost_after: float = np.inf,
        config: LocalizationConfig | None = None,
    ) -> None:
        self._content, self._stored = content, stored
        self._loops = loops or LoopConfig()
        self._config = config or LocalizationConfig()
        self._past: deque[_Past] = deque(maxlen=100)
        self._fix: _Past | None = None
        self._lost_after, self._unconfirmed_m = lost_after, 0.0
        self._odometry: Matrix | None = None  # of the last call

    def localize(self, sight: Observation, candidates: Mapping[int, float]) -> Localization:
        """Return map_from_cloud of what the robot sees, or why it is not known.

        Args:
            sight: what it sees, with a cloud.
            candidates: descriptor distances by number of the keyframe, in the order of trust.
        """
        before, self._odometry = self._odometry, sight.odometry
        if before is not None and sight.odometry is not None:
            self._unconfirmed_m += float(np.linalg.norm(sight.odometry[:3, 3] - before[:3, 3]))
        found = self._find(sight, candidates)
        if found.map_from_robot is not None:
            self._unconfirmed_m = 0.0
            return replace(found, unconfirmed_m=0.0, is_lost=False)
        if sight.odometry is None:
            return found
        driven = self._unconfirmed_m
        return replace(found, unconfirmed_m=driven, is_lost=driven > self._lost_after)

    def _find(self, sight: Observation, candidates: Mapping[int, float]) -> Localization:
        tracked = self._track(sight)
        if tracked is not None:
            return self._accept(sight, tracked)
        found, reason, nearest = self._search(sight, candidates)
        if found is None:
            return Localization(None, keyframe=nearest, reason=reason)
        if self._is_confirmed(sight, found):
            return self._accept(sight, found)
        self._remember(sight, found)
        text = (
            f"keyframe {found.keyframe} fits with probability {found.probability:.2f}, and "
            "neither another keyframe nor odometry confirms it"
        )
        return Localization(
            None, keyframe=found.keyframe, reason=Refusal("alone", found.probability, text)
        )

    def forget(self) -> None:
        """Forget where the robot was, as after it was carried."""
        self._past.clear()
        self._fix = self._odometry = None

    def _track(self, sight: Observation) -> _Guess | None:
        """Return the pose near the one that odometry predicts; None if nothing confirms it."""
        if self._fix is None or sight.odometry is None or self._is_old(self._fix, sight):
            return None
        expected = _move(self._fix, sight.odometry)
        guesses = self._ask(sight, expected, self._fix.keyframe)
        for one in guesses:
            if _differ(one.pose, expected, 2.0, 10.0):
                continue
            if any(self._agree(one.pose, other.pose) for other in guesses if other is not one):
                return one
            if self._agree(one.pose, expected):
                return one
        return None

    def _search(
        self, sight: Observation, candidates: Mapping[int, float]
    ) -> tuple[_Guess | None, Refusal | None, int | None]:
        """Return the best pose without a guess, or the reason and the best keyframe."""
        assert sight.cloud is not None
        pairs = PairComparisons(sight.cloud, self._stored)
        best, _ = verify_candidates(-1, candidates, pairs, self._loops)
        if best is None:
            return None, Refusal("no-candidates", 0, "no keyframe shows a similar place"), None
        if best.match_from_query is None or best.covariance is None:
            return None, best.reason, best.match
        probability = best.probability or 0.0
        least = self._least(sight)
        if probability < least:
            text = (
                f"keyframe {best.match} fits with probability {probability:.2f}, expected "
                f"{least:g} at least"
            )
            return None, best.reason or Refusal("improbable", probability, text), best.match
        pose = self._content.pose(best.match) @ best.match_from_query
        return _Guess(pose, best.covariance, best.match, probability), None, best.match

    def _is_confirmed(self, sight: Observation, found: _Guess) -> bool:
        guesses = self._ask(sight, found.pose, found.keyframe, exclude=found.keyframe)
        if any(self._agree(found.pose, other.pose) for other in guesses):
            return True
        if sight.odometry is None:
            return False
        part = self._content.part(found.keyframe)
        recent = [
            past for past in self._past if past.part == part and not self._is_old(past, sight)
        ]
        return any(self._agree(found.pose, _move(past, sight.odometry)) for past in recent)

    def _ask(
        self, sight: Observation, pose: Matrix, keyframe: int, exclude: int | None = None
    ) -> list[_Guess]:
        """Register the cloud with keyframes near a pose in a keyframe's part, starting there."""
        assert sight.cloud is not None
        guesses = []
        near = self._content.near(pose, self._config.neighborhood, keyframe)
        least = self._least(sight)
        for number in [each for each in near if each != exclude][: self._config.confirmations]:
            there, cloud = self._content.pose(number), self._stored(number).unpack()
            found = register(sight.cloud, cloud, np.linalg.inv(there) @ pose, search=False)
            moved, covariance = found.target_from_source, found.covariance
            probability = found.probability or 0.0
            if moved is None or covariance is None or probability < least:
                continue
            guesses.append(_Guess(there @ moved, covariance, number, probability))
        return guesses

    def _least(self, sight: Observation) -> float:
        """The least probability of a pose that is believed if another one confirms it."""
        least, rate = self._config.min_probability, self._loops.false_rate
        if rate is None or sight.cloud is None:
            return least
        return max(least, rule_of(sight.cloud, rate).supported)

    def _agree(self, one: Matrix, other: Matrix) -> bool:
        return not _differ(one, other, self._config.agreement, self._config.angle_agreement)

    def _is_old(self, past: _Past, sight: Observation) -> bool:
        if past.stamp_ns is None or sight.stamp_ns is None:
            return False
        return abs(sight.stamp_ns - past.stamp_ns) > self._config.memory * 1e9

    def _remember(self, sight: Observation, found: _Guess) -> int:
        """Keep a pose for the next ones; return its part of the map."""
        part = self._content.part(found.keyframe)
        if sight.odometry is not None:
            where = found.pose, sight.odometry, sight.stamp_ns, found.keyframe, part
            self._past.append(_Past(*where))
        return part

    def _accept(self, sight: Observation, found: _Guess) -> Localization:
        part = self._remember(sight, found)
        if sight.odometry is not None:
            self._fix = self._past[-1]
        return Localization(found.pose, found.covariance, found.keyframe, part=part)


def _move(past: _Past, odometry: Matrix) -> Matrix:
    moved: Matrix = past.pose @ np.linalg.inv(past.odometry) @ odometry
    return moved


def _differ(one: Matrix, other: Matrix, metres: float, degrees: float) -> bool:
    """Whether two poses are farther apart, or turned more against each other."""
    from scipy.spatial.transform import Rotation

    off = np.linalg.inv(one) @ other
    turn = np.degrees(Rotation.from_matrix(off[:3, :3]).magnitude())
    return bool(np.linalg.norm(off[:3, 3]) > metres or turn > degrees)
