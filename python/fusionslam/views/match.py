# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What a ``ViewMatcher`` says of a scan, and of all scans so far."""

from dataclasses import dataclass

NO_VIEW = -1
"""The id of scans that hold nothing to recognise."""


@dataclass(frozen=True)
class ViewMatch:
    """What a scan was recognised as.

    Attributes:
        id: of the place, counted from 0; -1 for a scan that holds nothing to recognise.
        similarity: of the best stored view, in [0, 1]; 0 where there is none.
        is_new: whether the id was given for the first time.
        reason: why, in a sentence.
        stored: whether this scan was stored.
        matched: number of the scan whose stored view it matched, counted from 0; None for none.
        relative_pose: x, y in metres and yaw in radians of this scan in the frame of that one,
            where the comparison finds it.
    """

    id: int
    similarity: float
    is_new: bool
    reason: str
    stored: bool
    matched: int | None = None
    relative_pose: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class ViewStats:
    """What a matcher did so far.

    Attributes:
        processed: scans.
        matched: to a stored view.
        new: places: ids given.
        nothing: scans that hold nothing to recognise.
        single: scans with a single object.
        stored: views stored now.
        dropped: views that made room for others.
        bytes: of all stored views in a file.
    """

    processed: int = 0
    matched: int = 0
    new: int = 0
    nothing: int = 0
    single: int = 0
    stored: int = 0
    dropped: int = 0
    bytes: int = 0

    @property
    def bytes_per_view(self) -> float:
        """Bytes of a stored view, the mean; 0 where nothing is stored."""
        return self.bytes / self.stored if self.stored else 0.0


@dataclass
class Slot:
    """A stored view: its place's id, the scan it was, and the last scan that needed it."""

    id: int
    number: int
    used: int
