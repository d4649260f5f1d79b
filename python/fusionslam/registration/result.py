# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The result of a registration, and why there may be none."""

from dataclasses import dataclass, field

import numpy as np

from fusionslam.base.arrays import Floats, Matrix
from fusionslam.registration.colors import ColorDifference


@dataclass(frozen=True)
class Refusal:
    """Why a registration has no pose.

    Attributes:
        code: "few-points" (number: voxels of the smaller cloud), "no-features" (points with
            neighbours), "no-match" (0), "tilted" (degrees), "low-overlap" (share), "degenerate"
            (directions) or "improbable" (probability).
        number: the value that was not good enough.
        text: the same in words.
    """

    code: str
    number: float
    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class Registration:
    """The pose of one cloud in the frame of another.

    Attributes:
        target_from_source: float64 (4, 4); None if it was refused.
        covariance: float64 (6, 6) of the pose's error: x, y, z in metres, then rotations about x,
            y, z in radians, as small motions in the source's frame
            (``target_from_source @ exp(error)``). None if the pose was refused.
        overlap: share of each cloud's points above the ground that the other cloud confirms, the
            smaller of both; 0 without an estimate. A point in space that the other sensor saw to be
            free counts against it, one that it cannot have seen a quarter, one out of its view not
            at all. Of method planar: share of the compared cells of the range images that agree.
        agreeing: number of those points, of the cloud that has fewer; 0 without an estimate, and of
            method planar.
        mean_overlap: the mean of both clouds' shares, of which ``overlap`` is the smaller.
        tilt: angle between the z axes of the clouds, degrees; 0 without an estimate.
        degenerate: float64 (k, 3), unit vectors in the source's frame along which the clouds can
            slide on each other at the estimate, as along a corridor.
        seconds: time it took.
        reason: why the pose was refused; None if it was not.
        probability: that the estimate is right; None without one.
        estimate: float64 (4, 4), the pose that was judged, refused or not; None if there was none.
            For pictures and diagnosis.
        color_difference: of the points above the ground that the estimate puts on each other;
            None without an estimate, without colours in both clouds, with fewer than 20 points,
            and of method planar, whose probability takes the colours into account.
    """

    target_from_source: Matrix | None
    covariance: Matrix | None
    overlap: float = 0.0
    tilt: float = 0.0
    degenerate: Floats = field(default_factory=lambda: np.empty((0, 3)))
    seconds: float = 0.0
    reason: Refusal | None = None
    probability: float | None = None
    estimate: Matrix | None = None
    color_difference: ColorDifference | None = None
    agreeing: int = 0
    mean_overlap: float = 0.0

    @property
    def accepted(self) -> bool:
        """Whether there is a pose."""
        return self.reason is None
