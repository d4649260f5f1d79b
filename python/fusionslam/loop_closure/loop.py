# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Values that loop detection returns."""

from dataclasses import dataclass, field
from typing import NamedTuple

from fusionslam.base.arrays import Matrix
from fusionslam.registration.result import Refusal


@dataclass(frozen=True)
class Loop:
    """Two frames that may show one place.

    Attributes:
        query, match: numbers of both frames, in the order of adding.
        distance: of their descriptors; of the detector's own, or of the one that proposed a match
            that is not among its nearest.
        match_from_query: float64 (4, 4): maps points of the query's cloud to the match's; None if
            the loop was not verified, or no pose was found.
        covariance: float64 (6, 6) of the pose's error, as ``Registration.covariance``; None
            without a pose that was accepted.
        overlap: share of what both clouds show that agrees; None if not verified.
        probability: that the pose is right; None if not verified.
        reason: why the loop does not count; None if it does, or was not verified.
        match_stamp_ns: time stamp of the match, nanoseconds; 0 if it had none, None if unknown.
    """

    query: int
    match: int
    distance: float
    match_from_query: Matrix | None = field(default=None, compare=False)
    covariance: Matrix | None = field(default=None, compare=False)
    overlap: float | None = None
    probability: float | None = None
    reason: Refusal | None = None
    match_stamp_ns: int | None = field(default=None, compare=False)


def may_be_right(candidate: Loop) -> bool:
    """Whether a candidate counts, or its pose is only not certain enough."""
    reason = candidate.reason
    return reason is None or reason.code in ("improbable", "low-overlap", "alone", "not-promised")


class Rejected(NamedTuple):
    """A candidate that was not accepted: its number, and why.

    Attributes:
        match: number of the frame.
        code: of ``Refusal``, or "less-alike" (number: correlation of images from above; others of
            the candidates correlate more), "far" (metres between the poses), "alone" (probability:
            no recent loop agrees), "not-promised" (probability: too little for
            ``LoopConfig.false_rate``).
        number: the value that was not good enough.
        text: the same in words.
    """

    match: int
    code: str
    number: float
    text: str
