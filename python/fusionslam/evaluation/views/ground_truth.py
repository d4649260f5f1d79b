# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Judge view ids by the robot's true poses, for a whole drive or scan by scan."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.evaluation.views.rules import ViewRule
from fusionslam.storage.arrays import Floats, Integers, Mask

_BLOCK = 1 << 20
"""Pairs of poses compared at a time: a few tens of megabytes."""


@dataclass(frozen=True, eq=False)
class TrueScans:
    """Scans in order of time.

    Attributes:
        rule: the limits that define the same place.
        poses: float64 (n, 3), true x, y in metres and yaw in radians.
        times: int64 (n,), as ``whole_nanoseconds`` gives them.
    """

    rule: ViewRule
    poses: Floats
    times: Integers

    def revisits(self, scans: Integers) -> Mask:
        """Bool (k,): those of these scans that return to an older true pose."""
        rule, everyone = self.rule, np.arange(len(self.times))
        older = np.searchsorted(self.times, self.times[scans] - self._loop_age, side="left")
        return self._has_near(scans, everyone, older, rule.revisit_distance, rule.revisit_angle)

    def judge(self, scans: Integers, first: Integers, stored: Integers) -> dict[str, NDArray[Any]]:
        """Judge the ids of some scans.

        Args:
            scans: int64 (k,), ascending.
            first: int64 (k,), the first scan with the same id, perhaps itself; -1 without an id.
            stored: int64 (m,), ascending: first scans of all ids, up to the last of ``scans``.

        Returns:
            (k,) each: matched, distances, angles, false_positive, false_negative, loop and
            loop_correct, as in ``ViewReport``.
        """
        rule = self.rule
        positive = (first >= 0) & (first < scans)
        distances, angles = self._apart(scans, np.where(positive, first, scans))
        wrong = positive & (
            (distances > rule.false_positive_distance) | (angles > rule.false_positive_angle)
        )
        near = (distances <= rule.loop_distance) & (angles <= rule.loop_angle)
        loop = positive & (self.times[scans] - self.times[first] > self._loop_age)
        return {
            "matched": np.where(positive, first, -1),
            "distances": np.where(positive, distances, np.nan),
            "angles": np.where(positive, angles, np.nan),
            "false_positive": wrong,
            "false_negative": self._wrongly_new(scans, positive, stored),
            "loop": loop,
            "loop_correct": loop & near,
        }

    @property
    def _loop_age(self) -> int:
        return round(self.rule.loop_age * 1e9)

    def _wrongly_new(self, scans: Integers, positive: Mask, stored: Integers) -> Mask:
        """Bool (k,): negatives that have an earlier stored scene within reach."""
        negatives = scans[~positive]
        earlier = np.searchsorted(stored, negatives, side="left")
        rule = self.rule
        wrong = np.zeros(len(scans), dtype=np.bool_)
        wrong[~positive] = self._has_near(
            negatives, stored, earlier, rule.false_negative_distance, rule.false_negative_angle
        )
        return wrong

    def _has_near(
        self, scans: Integers, others: Integers, counts: Integers, distance: float, angle: float
    ) -> Mask:
        """Bool (k,): scans within reach of one of the first ``counts[i]`` of the others."""
        found = np.zeros(len(scans), dtype=np.bool_)
        step = max(1, _BLOCK // max(1, len(others)))
        for start in range(0, len(scans), step):
            rows = slice(start, start + step)
            most = int(counts[rows].max())
            near = self._roughly_near(scans[rows], others[:most], distance)
            near &= np.arange(most) < counts[rows, None]
            row, other = np.nonzero(near)
            distances, angles = self._apart(scans[rows][row], others[other])
            found[start + row[(distances <= distance) & (angles <= angle)]] = True
        return found

    def _roughly_near(self, scans: Integers, others: Integers, distance: float) -> Mask:
        """Bool (n, m): positions within a distance, or beyond it by a rounding error."""
        x, y = self.poses[:, 0], self.poses[:, 1]
        across = x[scans][:, None] - x[others]
        along = y[scans][:, None] - y[others]
        across *= across
        along *= along
        across += along
        reach: Mask = across <= (distance * (1 + 1e-9)) ** 2
        return reach

    def _apart(self, scans: Integers, others: Integers) -> tuple[Floats, Floats]:
        """Distances (m) and angles (degrees, 0 to 180) between scans, broadcast."""
        here, there = self.poses[scans], self.poses[others]
        distances = np.hypot(here[..., 0] - there[..., 0], here[..., 1] - there[..., 1])
        turn = np.degrees(here[..., 2] - there[..., 2]) % 360.0
        return distances, np.minimum(turn, 360.0 - turn)


def whole_nanoseconds(stamps: Floats) -> Integers:
    """Convert seconds to integers, so that an age of ``loop_age`` is exact for every pair."""
    return np.rint(stamps * 1e9).astype(np.int64)
