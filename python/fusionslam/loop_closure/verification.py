# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Proves loops by registration: of the candidates that descriptors propose, the one that fits."""

import time
from collections import deque
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from fusionslam.base.arrays import Matrix
from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.contract import Rule, rule_of
from fusionslam.loop_closure.loop import Loop, Rejected, may_be_right
from fusionslam.registration import (
    Hypothesis,
    PreparedCloud,
    Refusal,
    Registration,
    SearchImage,
    compare_images,
    register,
    search_poses,
)

T = TypeVar("T")


@dataclass(frozen=True)
class StoredFrame:
    """An earlier frame, to be had even after it is forgotten.

    Attributes:
        stamp_ns: time stamp; 0 if it had none.
        odometry: odom_from_cloud, float64 (4, 4); None if unknown.
        image: its cloud's images from above, by which it is found; None where none are used.
        unpack: returns its cloud.
    """

    stamp_ns: int
    odometry: Matrix | None
    image: SearchImage | None
    unpack: Callable[[], PreparedCloud]


class PairComparisons:
    """Compares a frame's cloud with those of earlier frames, each pair once however often asked.

    What it returns depends on the pair alone, so that several descriptors may share one.

    Args:
        cloud: of the frame.
        stored: returns an earlier frame by its number.

    Attributes:
        cloud: of the frame.
        seconds: that all answers took, those that were known already as well.
    """

    def __init__(self, cloud: PreparedCloud, stored: Callable[[int], StoredFrame]) -> None:
        self.cloud, self._stored = cloud, stored
        self._frames: dict[int, StoredFrame] = {}
        self._known: dict[Hashable, tuple[object, float]] = {}
        self.seconds = 0.0

    def reach(self, match: int) -> float:
        """Way behind a frame that a local map of both shows as well, metres; 0 of single clouds."""
        is_joined = self.cloud.further or self.frame(match).unpack().further
        return (self.cloud.config.local_map or 0.0) if is_joined else 0.0

    def frame(self, match: int) -> StoredFrame:
        """Return an earlier frame."""
        if match not in self._frames:
            self._frames[match] = self._stored(match)
        return self._frames[match]

    def correlate(self, match: int) -> float:
        """Return the largest correlation of both images from above, coarsely."""
        cloud, image = self.cloud, self._image(match)
        self._once("images", lambda: cloud.coarse_images)  # which all pairs need
        return self._once(("correlate", match), lambda: compare_images(cloud, image))

    def search(self, match: int) -> list[Hypothesis]:
        """Return the poses at which both images from above correlate most."""
        image = self._image(match)
        return self._once(("search", match), lambda: search_poses(self.cloud, image))

    def register(self, match: int, guess: Matrix | None, *, thorough: bool) -> Registration:
        """Register the clouds, from a pose that ``search`` returned or by a search of its own."""
        key = "register", match, None if guess is None else guess.tobytes(), thorough
        return self._once(
            key,
            lambda: register(
                self.cloud,
                self.frame(match).unpack(),
                guess,
                search=guess is None,
                thorough=thorough,
                leveled=True,
            ),
        )

    def _image(self, match: int) -> SearchImage:
        image = self.frame(match).image
        assert image is not None  # all candidates have one, or none is correlated
        return image

    def _once(self, key: Hashable, compute: Callable[[], T]) -> T:
        if key not in self._known:
            started = time.perf_counter()
            value = compute()
            self._known[key] = value, time.perf_counter() - started
        known, seconds = self._known[key]
        self.seconds += seconds
        return known  # type: ignore[return-value]


class Verified(NamedTuple):
    """The best candidate of a frame, accepted unless it has a reason, and all others."""

    best: Loop | None
    rejected: list[Rejected]


def verify_candidates(
    query: int,
    candidates: Mapping[int, float],
    pairs: PairComparisons,
    config: LoopConfig,
) -> Verified:
    """Register a frame's cloud with its candidates.

    Where images from above can be compared, only those candidates whose images correlate most are
    registered; else all, the first ones thoroughly. It ends with the first pose that counts.

    Args:
        query: number of the frame.
        candidates: descriptor distances by number of the frame, in the order of trust.
        pairs: of its cloud and theirs.
        config: what is tried and accepted.
    """
    tries, left = _choose(candidates, pairs, config.refined)
    rate = config.false_rate
    rule = None if rate is None else rule_of(pairs.cloud, rate)
    best: Loop | None = None
    rejected: list[Rejected] = []
    for done, (match, guess) in enumerate(tries):
        found = pairs.register(match, guess, thorough=done < config.refined)
        loop = Loop(
            query,
            match,
            candidates[match],
            match_from_query=found.estimate,
            covariance=found.covariance,
            overlap=found.overlap,
            probability=found.probability or 0.0,
            reason=_refusal(found, config, pairs.reach(match), rule),
            match_stamp_ns=pairs.frame(match).stamp_ns,
        )
        if best is None or _rank(loop) > _rank(best):
            best, loop = loop, best
        if loop is not None:
            rejected.append(_rejection(loop))
        if best.reason is None:
            text = f"frame {best.match} fits"
            rejected += [Rejected(match, "not-needed", 0, text) for match, _ in tries[done + 1 :]]
            break
    return Verified(best, rejected + left)


def _choose(
    candidates: Mapping[int, float], pairs: PairComparisons, most: int
) -> tuple[list[tuple[int, Matrix | None]], list[Rejected]]:
    """Return what to register, each with a guess, the most promising first, and what not."""
    if any(pairs.frame(match).image is None for match in candidates):
        return [(match, None) for match in candidates], []
    likely = sorted(
        ((pairs.correlate(match), match) for match in candidates), key=lambda each: -each[0]
    )
    shown = [(height, match) for height, match in likely if height > 0]
    found = [
        (each.correlation, match, each.pose)
        for _, match in shown[: _SEARCHED * most]
        for each in pairs.search(match)
    ]
    found.sort(key=lambda each: -each[0])
    left = [(height, match) for height, match, _ in found[most:]] + shown[_SEARCHED * most :]
    rejected = [
        Rejected(match, "less-alike", height, f"correlation {height:.2f}, others have more")
        for height, match in left
    ]
    text = "a cloud shows nothing above the ground nearby"
    empty = [match for height, match in likely if not height > 0]
    rejected += [Rejected(match, "no-match", 0, text) for match in empty]
    return [(match, pose) for _, match, pose in found[:most]], rejected


_SEARCHED = 2
"""Times as many poses are searched as are registered."""


def _refusal(
    found: Registration, config: LoopConfig, reach: float, rule: Rule | None
) -> Refusal | None:
    """Why a registered pose is no loop by itself; None if it is one."""
    if found.estimate is None:
        return found.reason
    apart, probability = float(np.linalg.norm(found.estimate[:3, 3])), found.probability or 0.0
    most = config.max_distance + reach
    if apart > most:
        return Refusal("far", apart, f"poses {apart:.1f} m apart, more than {most:g}")
    if found.reason is not None:
        return found.reason
    if rule is not None and probability < rule.supported:
        text = f"probability {probability:.4f}, and false_rate asks for {rule.supported:g}"
        return Refusal("not-promised", probability, text)
    least = config.min_probability if rule is None else max(config.min_probability, rule.alone)
    if probability < least:
        text = f"probability {probability:.2f}, less than {least:g}"
        return Refusal("improbable", probability, text)
    return None


def _rank(loop: Loop) -> tuple[bool, bool, float, float]:
    """What counts first, then by probability; a pose that is far or tilted is no place at all."""
    return loop.reason is None, may_be_right(loop), loop.probability or 0.0, loop.overlap or 0.0


def _rejection(loop: Loop) -> Rejected:
    assert loop.reason is not None  # the search ends with the first that counts
    return Rejected(loop.match, loop.reason.code, loop.reason.number, loop.reason.text)


_FRAMES = 4
_FLOOR_M, _FLOOR_DEG = 0.3, 1.5
"""Three standard deviations of two registered poses."""


class _Recent(NamedTuple):
    """A frame's best candidate, and the odometry of both of its frames."""

    match_from_query: Matrix
    query: Matrix
    match: Matrix
    stretches: tuple[int, int]


class SequenceGate:
    """Loops that are not certain by themselves count if those of neighbouring frames agree.

    It remembers the best candidates of the last frames. Two agree if odometry, between both queries
    and between both matches, joins their poses within its drift and three standard deviations of
    theirs.
    """

    def __init__(self, config: LoopConfig) -> None:
        self._config = config
        self._recent: deque[_Recent | None] = deque(maxlen=_FRAMES - 1)

    def decide(
        self,
        found: Verified,
        odometry: Matrix | None,
        stored: Callable[[int], StoredFrame],
        stretches: Mapping[int, int] | None = None,
    ) -> Verified:
        """Return what ``verify_candidates`` found of the next frame, as its neighbours confirm it.

        Args:
            found: of the frame. All that is no loop is among the rejected then.
            odometry: float64 (4, 4), odom_from_cloud of the frame; None if unknown.
            stored: returns an earlier frame by its number.
            stretches: number of the stretch of odometry by frame; None if there is one.
        """
        best, match, between = found.best, None, (0, 0)
        if best is not None:
            match = stored(best.match).odometry
            if stretches is not None:
                between = stretches[best.query], stretches[best.match]
        best = self.judge(best, odometry, match, between)
        if best is None or best.reason is None:
            return Verified(best, found.rejected)
        return Verified(best, [_rejection(best), *found.rejected])

    def judge(
        self,
        best: Loop | None,
        query: Matrix | None,
        match: Matrix | None,
        stretches: tuple[int, int] = (0, 0),
    ) -> Loop | None:
        """Return the candidate, without its reason if another recent one agrees with it.

        Args:
            best: of the frame.
            query, match: float64 (4, 4), odom_from_cloud of both frames; None if unknown.
            stretches: numbers of the stretches of odometry that both belong to; odometry of
                different ones, as of two sessions, cannot be compared.
        """
        entry, judged = None, best
        if (
            best is not None
            and best.match_from_query is not None
            and best.covariance is not None
            and query is not None
            and match is not None
            and may_be_right(best)
            and (best.reason is None or best.reason.code != "not-promised")
            and (best.probability or 0.0) >= self._config.min_supported
        ):
            entry = _Recent(best.match_from_query, query, match, stretches)
            if best.reason is not None:
                reason = None
                if not any(self._agree(entry, each) for each in self._recent if each is not None):
                    probability = best.probability or 0.0
                    text = f"probability {probability:.2f}, and no recent loop agrees"
                    reason = Refusal("alone", probability, text)
                judged = replace(best, reason=reason)
        self._recent.append(entry)
        return judged

    def _agree(self, one: _Recent, other: _Recent) -> bool:
        from scipy.spatial.transform import Rotation

        if one.stretches != other.stretches:
            return False
        queries = np.linalg.inv(other.query) @ one.query  # other_from_one
        matches = np.linalg.inv(other.match) @ one.match
        joined = np.linalg.inv(other.match_from_query @ queries) @ matches @ one.match_from_query
        way = float(np.linalg.norm(queries[:3, 3]) + np.linalg.norm(matches[:3, 3]))
        off = float(np.linalg.norm(joined[:3, 3]))
        turned = float(np.degrees(Rotation.from_matrix(joined[:3, :3]).magnitude()))
        config = self._config
        return off <= _FLOOR_M + config.drift * way and turned <= _FLOOR_DEG + (
            config.drift_angle * way
        )
