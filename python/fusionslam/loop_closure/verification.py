# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Proves loops by registration: of the candidates that descriptors propose, the one that fits."""

import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.loop import Loop, Rejected
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
from fusionslam.storage.arrays import Matrix

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
        seconds: that all answers took, those that were known already as well.
    """

    def __init__(self, cloud: PreparedCloud, stored: Callable[[int], StoredFrame]) -> None:
        self._cloud, self._stored = cloud, stored
        self._frames: dict[int, StoredFrame] = {}
        self._known: dict[Hashable, tuple[object, float]] = {}
        self.seconds = 0.0

    def can_correlate(self, match: int) -> bool:
        """Whether an earlier frame has images from above."""
        return self._frame(match).image is not None

    def correlate(self, match: int) -> float:
        """Return the largest correlation of both images from above, coarsely."""
        cloud, image = self._cloud, self._image(match)
        self._once("images", lambda: cloud.coarse_images)  # which all pairs need
        return self._once(("correlate", match), lambda: compare_images(cloud, image))

    def search(self, match: int) -> list[Hypothesis]:
        """Return the poses at which both images from above correlate most."""
        image = self._image(match)
        return self._once(("search", match), lambda: search_poses(self._cloud, image))

    def register(self, match: int, guess: Matrix | None, *, thorough: bool) -> Registration:
        """Register the clouds, from a guess or by a search."""
        key = "register", match, None if guess is None else guess.tobytes(), thorough
        return self._once(
            key,
            lambda: register(
                self._cloud,
                self._frame(match).unpack(),
                guess,
                search=guess is None,
                thorough=thorough,
            ),
        )

    def _frame(self, match: int) -> StoredFrame:
        if match not in self._frames:
            self._frames[match] = self._stored(match)
        return self._frames[match]

    def _image(self, match: int) -> SearchImage:
        image = self._frame(match).image
        assert image is not None  # as can_correlate says
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


class _Try(NamedTuple):
    match: int
    guess: Matrix | None


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
    best: Loop | None = None
    rejected: list[Rejected] = []
    for done, (match, guess) in enumerate(tries):
        found = pairs.register(match, guess, thorough=done < config.refined)
        loop = _judge(query, match, candidates[match], found, config)
        if best is None or _rank(loop) > _rank(best):
            best, loop = loop, best
        if loop is not None:
            rejected.append(_rejection(loop))
        if best.reason is None:
            text = f"frame {best.match} fits"
            rejected += [Rejected(each.match, "not-needed", 0, text) for each in tries[done + 1 :]]
            break
    return Verified(best, rejected + left)


def _choose(
    candidates: Mapping[int, float], pairs: PairComparisons, most: int
) -> tuple[list[_Try], list[Rejected]]:
    """Return what to register, the most promising first, and what not."""
    if not all(pairs.can_correlate(match) for match in candidates):
        return [_Try(match, None) for match in candidates], []
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
    return [_Try(match, pose) for _, match, pose in found[:most]], rejected


_SEARCHED = 2
"""Times as many poses are searched as are registered."""


def _judge(
    query: int, match: int, distance: float, found: Registration, config: LoopConfig
) -> Loop:
    reason, probability = found.reason, found.probability or 0.0
    if found.estimate is not None:
        apart = float(np.linalg.norm(found.estimate[:3, 3]))
        if apart > config.max_distance:
            text = f"poses {apart:.1f} m apart, more than {config.max_distance:g}"
            reason = Refusal("far", apart, text)
        elif reason is None and probability < config.min_probability:
            text = f"probability {probability:.2f}, less than {config.min_probability:g}"
            reason = Refusal("improbable", probability, text)
    return Loop(
        query,
        match,
        distance,
        match_from_query=found.estimate,
        covariance=found.covariance,
        overlap=found.overlap,
        probability=probability,
        reason=reason,
    )


def _rank(loop: Loop) -> tuple[bool, bool, float, float]:
    """What counts first, then by probability; a pose that is far or tilted is no place at all."""
    soft = loop.reason is None or loop.reason.code in ("improbable", "low-overlap")
    return loop.reason is None, soft, loop.probability or 0.0, loop.overlap or 0.0


def list_rejected(best: Loop | None, others: list[Rejected]) -> list[Rejected]:
    """Return all candidates that are no loop, the best first if it is none either."""
    return others if best is None or best.reason is None else [_rejection(best), *others]


def _rejection(loop: Loop) -> Rejected:
    assert loop.reason is not None  # the search ends with the first that counts
    return Rejected(loop.match, loop.reason.code, loop.reason.number, loop.reason.text)
