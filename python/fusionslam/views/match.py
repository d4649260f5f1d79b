# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Results of a ``ViewMatcher``: one per scan, and counts over all scans."""

from dataclasses import dataclass
from typing import NamedTuple

NO_VIEW = -1
"""The id of scans without anything to recognise, and of those that may show several places."""


class Revision(NamedTuple):
    """An earlier answer that turned out to be another one.

    Attributes:
        scan: number of the scan, counted from 0.
        id: its place; -1 if the answer was wrong, and the place is not known.
    """

    scan: int
    id: int


@dataclass(frozen=True)
class ViewMatch:
    """The place recognised in a scan.

    Attributes:
        id: id of the place, counted from 0; -1 for a scan without anything to recognise, or an
            ambiguous one.
        similarity: similarity to the best stored view, in [0, 1]; 0 if there is none. With
            odometry: the probability of the answer.
        is_new: whether the place is new.
        reason: the reason, as a sentence.
        stored: whether this scan was stored.
        matched: number of the matched stored scan, counted from 0; None without a match.
        relative_pose: x, y in metres and yaw in radians of this scan in the frame of the matched
            one; None if the comparison does not estimate it.
        is_ambiguous: whether the scan may show one of several places, or a new one, and odometry
            does not decide.
        candidates: with odometry: places that were considered, most probable first, and the
            probability of each.
        look_alikes: with odometry: number of other places that look like the scan.
        by_odometry: whether odometry alone has the robot at the place: the scan did not show it.
        guess: of an ambiguous scan of a lost robot: the place that the scan alone shows, if any;
            ``matched`` and ``relative_pose`` are of it.
        revised: earlier scans whose answers turned out to be others.
    """

    id: int
    similarity: float
    is_new: bool
    reason: str
    stored: bool
    matched: int | None = None
    relative_pose: tuple[float, float, float] | None = None
    is_ambiguous: bool = False
    candidates: tuple[tuple[int, float], ...] = ()
    look_alikes: int = 0
    by_odometry: bool = False
    guess: int | None = None
    revised: tuple[Revision, ...] = ()


@dataclass
class ViewStats:
    """Counts of what a matcher has done so far.

    Attributes:
        processed: scans processed.
        matched: scans that matched a stored view.
        new: new places, which is the number of ids given.
        nothing: scans without anything to recognise.
        ambiguous: scans that may show several places.
        by_odometry: scans that matched because of odometry alone.
        revised: answers that were revised.
        single: scans with a single object.
        stored: views stored now.
        dropped: views removed to make room for others.
        bytes: size of all stored views in a file.
    """

    processed: int = 0
    matched: int = 0
    new: int = 0
    nothing: int = 0
    ambiguous: int = 0
    by_odometry: int = 0
    revised: int = 0
    single: int = 0
    stored: int = 0
    dropped: int = 0
    bytes: int = 0

    @property
    def bytes_per_view(self) -> float:
        """Mean size of a stored view in bytes; 0 if nothing is stored."""
        return self.bytes / self.stored if self.stored else 0.0


@dataclass
class Slot:
    """A stored view.

    Attributes:
        id: of its place.
        number: of its scan.
        used: number of the last scan that matched it, or its own.
        absent: the most scans between two that used it.
    """

    id: int
    number: int
    used: int
    absent: int = 0

    def use(self, number: int) -> None:
        """Note that a scan matched this view."""
        self.absent = max(self.absent, number - self.used)
        self.used = number
