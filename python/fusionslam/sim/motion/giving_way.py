# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Moves along a path that never meet others, which do not give way."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Mask
from fusionslam.geometry.trajectory import Trajectory

STEP_S = 0.1
"""Time between two places of a moving thing."""
# Largest distance between the discs that cover something long, metres.
_SPACING_M = 1.0


@dataclass(frozen=True, eq=False)
class Track:
    """Places that a footprint takes, one after the other; the footprint is a line of discs.

    Attributes:
        places: float64 (N, 2), x and y of its middle, metres.
        yaw: float64 (N,), direction of the line of discs and of the motion, radians.
        radius_m: of the discs.
        half_m: from the middle to the last disc; 0 for a single one.
    """

    places: Floats
    yaw: Floats
    radius_m: float
    half_m: float = 0.0

    @property
    def reach_m(self) -> float:
        """From the middle to the last disc between two places: half a step farther."""
        steps = np.linalg.norm(np.diff(self.places, axis=0), axis=1)
        return self.half_m + float(steps.max(initial=0)) / 2

    def discs(self, chosen: NDArray[np.intp]) -> Floats:
        """Middles of the discs at chosen places, float64 (M, D, 2)."""
        reach = self.reach_m
        along = np.linspace(-reach, reach, 2 * int(np.ceil(reach / _SPACING_M)) + 1)
        ahead = np.stack([np.cos(self.yaw[chosen]), np.sin(self.yaw[chosen])], axis=1)
        middles: Floats = self.places[chosen, None] + along[:, None] * ahead[:, None]
        return middles


def move_times(trajectory: Trajectory, duration_s: float) -> Floats:
    """Times from the trajectory's start at which places are planned, float64 (T,), seconds."""
    count = max(int(np.ceil(duration_s / STEP_S)), 1) + 1
    seconds: Floats = trajectory.seconds[0] + np.linspace(0.0, duration_s, count)
    return seconds


def robot_track(trajectory: Trajectory, seconds: Floats, radius_m: float) -> Track:
    """Where a robot of this radius is at these times."""
    x, y, yaw = trajectory.places(seconds)
    return Track(np.stack([x, y], axis=1), yaw, radius_m)


def find_meetings(path: Track, others: Sequence[Track]) -> Mask:
    """True where one at a point of its path would touch another at a time, bool (T, S).

    Args:
        path: its S points, at none of which it has to be at a certain time.
        others: where they are at T times.
    """
    meets = np.zeros((len(others[0].places), len(path.places)), dtype=bool)
    for other in others:
        near = path.radius_m + other.radius_m
        far = near + path.reach_m + other.reach_m
        gaps = path.places.min(axis=0) - other.places.max(axis=0)
        gaps = np.maximum(gaps, other.places.min(axis=0) - path.places.max(axis=0))
        if gaps.max() > far:
            continue
        apart = np.linalg.norm(other.places[:, None] - path.places[None], axis=2)
        meets |= apart < near
        time, point = np.nonzero((apart >= near) & (apart < far))
        between = path.discs(point)[:, :, None] - other.discs(time)[:, None]
        meets[time, point] |= (np.linalg.norm(between, axis=3) < near).any(axis=(1, 2))
    return meets


def choose_moves(
    meets: Mask, rng: np.random.Generator, *, closed: bool = False
) -> NDArray[np.int64] | None:
    """Index on the path at each time, (T,), without a meeting.

    On an open path it goes on, waits or turns back; on a closed one it goes on or waits. Backward
    pass: a point is safe at a time if it is free then and a point that is safe at the next time is
    within reach. None if no point is safe at the start.
    """
    safe = ~meets
    for time in range(len(safe) - 2, -1, -1):
        after = safe[time + 1]
        reach = after | np.roll(after, -1)
        if not closed:
            reach[-1] = after[-1]
            reach[1:] |= after[:-1]
        safe[time] &= reach
    starts = np.flatnonzero(safe[0])
    if not len(starts):
        return None
    place, ahead = int(rng.choice(starts)), 1
    way = [place]
    for row in safe[1:]:
        if closed:
            place = next(k for k in ((place + 1) % len(row), place) if row[k])
        else:
            if not 0 <= place + ahead < len(row):
                ahead = -ahead
            choices = (place + ahead, place, place - ahead)
            place = next(k for k in choices if 0 <= k < len(row) and row[k])
        way.append(place)
    return np.array(way)
