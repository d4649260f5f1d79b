# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Proves loops by registration: of the candidates that descriptors propose, the one that fits."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusionslam.loop_closure.config import LoopConfig
from fusionslam.loop_closure.loop import Loop, Rejected
from fusionslam.registration import (
    PreparedCloud,
    Refusal,
    Registration,
    SearchImage,
    compare_images,
    register,
    search_poses,
)
from fusionslam.storage.arrays import Matrix


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


class Verified(NamedTuple):
    """The best candidate of a frame, accepted unless it has a reason, and all others."""

    best: Loop | None
    rejected: list[Rejected]


class _Try(NamedTuple):
    match: int
    guess: Matrix | None


def verify_candidates(
    query: int,
    cloud: PreparedCloud,
    candidates: Mapping[int, float],
    stored: Callable[[int], StoredFrame],
    config: LoopConfig,
) -> Verified:
    """Register a frame's cloud with its candidates.

    Where images from above can be compared, only those candidates whose images correlate most are
    registered; else all, the first ones thoroughly. It ends with the first pose that counts.

    Args:
        query: number of the frame.
        cloud: its cloud.
        candidates: descriptor distances by number of the frame, in the order of trust.
        stored: the cloud of an earlier frame.
        config: what is tried and accepted.
    """
    tries, left = _choose(cloud, candidates, stored, config.refined)
    best: Loop | None = None
    rejected: list[Rejected] = []
    for done, (match, guess) in enumerate(tries):
        found = register(
            cloud,
            stored(match).unpack(),
            guess,
            search=guess is None,
            thorough=done < config.refined,
        )
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
    cloud: PreparedCloud,
    candidates: Mapping[int, float],
    stored: Callable[[int], StoredFrame],
    most: int,
) -> tuple[list[_Try], list[Rejected]]:
    """Return what to register, the most promising first, and what not."""
    images = {match: stored(match).image for match in candidates}
    if None in images.values():
        return [_Try(match, None) for match in candidates], []
    likely = sorted(
        ((compare_images(cloud, image), match) for match, image in images.items() if image),
        key=lambda each: -each[0],
    )
    shown = [(height, match) for height, match in likely if height > 0]
    found = [
        (each.correlation, match, each.pose)
        for _, match in shown[: _SEARCHED * most]
        if (image := images[match]) is not None
        for each in search_poses(cloud, image)
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


def _rejection(loop: Loop) -> Rejected:
    assert loop.reason is not None  # the search ends with the first that counts
    return Rejected(loop.match, loop.reason.code, loop.reason.number, loop.reason.text)
