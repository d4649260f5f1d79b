# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Moves along a path that never meet others, which do not give way."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Mask

STEP_S = 0.1
"""Time between two places of a moving thing."""
# Between the discs that cover something long, metres.
_SPACING_M = 1.0


@dataclass(frozen=True, eq=False)
class Track:
    """Places that a footprint takes, one after the other; the footprint is a line of discs.

    Attributes:
        places: float64 (N, 2), x and y of its middle, metres.
        yaw: float64 (N,), along the line of discs, radians.
        reach_m: radius of the discs.
        half_m: from the middle to the last disc; 0 for a single one.
    """

    places: Floats
    yaw: Floats
    reach_m: float
    half_m: float = 0.0

    @classmethod
    def round(cls, places: Floats, radius_m: float) -> "Track":
        """Of a disc, grown by half a step: so much nearer it comes between two places."""
        return cls(places, np.zeros(len(places)), radius_m + _longest_step(places) / 2)

    @classmethod
    def long(cls, places: Floats, yaw: Floats, radius_m: float, half_m: float) -> "Track":
        """Of a line of discs that moves along itself, longer by half a step at both ends."""
        return cls(places, yaw, radius_m, half_m + _longest_step(places) / 2)

    def discs(self, chosen: NDArray[np.intp]) -> Floats:
        """Middles of the discs at chosen places, float64 (M, D, 2)."""
        count = 2 * int(np.ceil(self.half_m / _SPACING_M)) + 1
        along = np.linspace(-self.half_m, self.half_m, count)
        ahead = np.stack([np.cos(self.yaw[chosen]), np.sin(self.yaw[chosen])], axis=1)
        middles: Floats = self.places[chosen, None] + along[:, None] * ahead[:, None]
        return middles


def find_meetings(path: Track, others: Sequence[Track]) -> Mask:
    """True where one at a point of its path would touch another at a time, bool (T, S).

    Args:
        path: its S points, at none of which it has to be at a certain time.
        others: where they are at T times.
    """
    meets = np.zeros((len(others[0].places), len(path.places)), dtype=bool)
    for other in others:
        reach = path.reach_m + other.reach_m
        apart = np.linalg.norm(other.places[:, None] - path.places[None], axis=2)
        if not (path.half_m or other.half_m):
            meets |= apart < reach
            continue
        time, point = np.nonzero(apart < reach + path.half_m + other.half_m)
        between = path.discs(point)[:, :, None] - other.discs(time)[:, None]
        meets[time, point] |= (np.linalg.norm(between, axis=3) < reach).any(axis=(1, 2))
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


def _longest_step(places: Floats) -> float:
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).max(initial=0))
