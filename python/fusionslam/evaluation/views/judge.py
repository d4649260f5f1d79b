# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Judge view ids against true poses (Stastny 2022, 5.2), and by the loops they close.

``baselines`` are the ids of programs without a sensor, which every method in a table must beat.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats, Integers, Mask, read_numbers
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.evaluation.views.report import ViewReport
from fusionslam.evaluation.views.rules import ViewRule, view_rule

_BLOCK = 1 << 20
"""Pairs of poses compared at a time: a few tens of megabytes."""
_MOST_SCANS = 10**8  # three years of ten a second
_SECONDS = 9e9
"""Larger stamps (beyond the year 2255) are not seconds."""


@checked
def judge_views(
    ids: ArrayLike, poses: ArrayLike, stamps: ArrayLike, *, rule: str | ViewRule = "paper"
) -> ViewReport:
    """Judge the view ids that a place recognition gave to the scans of a drive.

    Args:
        ids: integers (n,), one per scan in order of time; any numbering. The stored scene of an id
            is the first scan that has it. A negative id means no view: the scan holds nothing to
            recognise. It counts as a negative and in ``unplaced``, and is never stored.
        poses: (n, 3), true x, y in metres and yaw in radians.
        stamps: (n,), seconds, not decreasing.
        rule: "paper", "author" (FACTS: angles of the author's program), "car", or a ``ViewRule``.

    Raises:
        ShapeError: wrong shape, length or dtype.
        DataError: a pose or stamp that is not finite, or stamps that go back.
        ConfigError: unknown rule.
    """
    return ViewJudge(poses, stamps, rule=rule).judge(ids)


@checked
class ViewJudge:
    """A drive with ground truth: judges any number of id sequences, as ``judge_views`` does.

    Sweeps and tuning judge thousands of sequences over one drive, so what depends on the ground
    truth alone is computed once. Arguments and errors are those of ``judge_views``. Memory is
    linear in the number of scans.

        judge = ViewJudge(poses, stamps)
        reports = [judge.judge(ids) for ids in candidates]
    """

    def __init__(
        self, poses: ArrayLike, stamps: ArrayLike, *, rule: str | ViewRule = "paper"
    ) -> None:
        self.rule_name, self.rule = view_rule(rule)
        self.poses = validate_poses(poses)
        self.stamps = validate_stamps(stamps, len(self.poses))
        self._truth = TrueScans(self.rule, self.poses, whole_nanoseconds(self.stamps))

    def __len__(self) -> int:
        return len(self.poses)

    @cached_property
    def revisit(self) -> Mask:
        """Bool (n,): scans that return to an older true pose."""
        return self._truth.revisits(np.arange(len(self)))

    def judge(self, ids: ArrayLike) -> ViewReport:
        """Judge these ids, integers (n,). Raises ShapeError."""
        views = validate_ids(ids, len(self))
        first, scans = first_scenes(views), np.arange(len(self))
        stored = np.flatnonzero(first == scans)
        return ViewReport(
            n=len(self),
            views=len(stored),
            unplaced=int((views < 0).sum()),
            rule_name=self.rule_name,
            rule=self.rule,
            ids=views,
            revisit=self.revisit,
            **self._truth.judge(scans, first, stored),
        )


@checked
def always_new(n: int) -> Integers:
    """Ids int64 (n,) of a program that calls each of n scans a new view.

    Raises:
        ConfigError: n is not 0 to 100 million.
    """
    return every_kth(n, 1)


@checked
def every_kth(n: int, k: int) -> Integers:
    """Ids int64 (n,) of a program that starts a new view with every k-th of n scans.

    Raises:
        ConfigError: n is not 0 to 100 million, or k not 1 to 2**62.
    """
    if not 0 <= n <= _MOST_SCANS:
        raise ConfigError(f"n is {n}, expected 0 to {_MOST_SCANS} scans")
    if not 1 <= k <= 2**62:
        raise ConfigError(f"k is {k}, expected a new view every 1 to 2**62 scans")
    return np.arange(n, dtype=np.int64) // k


@checked
def baselines(n: int) -> dict[str, Integers]:
    """Return the ids int64 (n,) of the baselines that appear in every table, by name."""
    return {
        "always new": always_new(n),
        "new every 2nd": every_kth(n, 2),
        "new every 3rd": every_kth(n, 3),
    }


def first_scenes(ids: Integers) -> Integers:
    """Int64 (n,): the first scan with the same id; -1 where the id is negative."""
    _, first, which = np.unique(ids, return_index=True, return_inverse=True)
    return np.where(ids >= 0, first[which], -1).astype(np.int64)


def validate_ids(ids: Any, count: int) -> Integers:
    """Return ids as int64 (count,). Raises ShapeError; DataError for what int64 cannot hold."""
    views = np.asarray(ids)
    if views.shape != (count,) or (views.dtype.kind not in "iu" and count):
        raise ShapeError(
            f"ids: {views.dtype} {views.shape}, expected integers ({count},): one id a pose"
        )
    if views.dtype.kind == "u" and count and views.max() > np.iinfo(np.int64).max:
        raise DataError(f"ids: {views.max()} is too large for int64")
    return views.astype(np.int64)


def validate_poses(poses: Any) -> Floats:
    """Return poses as float64 (n, 3). Raises ShapeError, or DataError that names the row."""
    rows = read_numbers("poses", poses, "(n, 3): x, y in metres, yaw in radians")
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ShapeError(f"poses: {rows.shape}, expected (n, 3): x, y in metres, yaw in radians")
    broken = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if broken.size:
        raise DataError(f"poses: row {broken[0]} is {rows[broken[0]].tolist()}, expected numbers")
    return rows


def validate_stamps(stamps: Any, count: int) -> Floats:
    """Return stamps as float64 (count,), s. Raises ShapeError, or DataError naming the row."""
    times = read_numbers("stamps", stamps, f"({count},): seconds")
    if times.shape != (count,):
        raise ShapeError(f"stamps: {times.shape}, expected ({count},): one stamp a pose")
    broken = np.flatnonzero(~np.isfinite(times))
    if broken.size:
        raise DataError(f"stamps: row {broken[0]} is {times[broken[0]]}, expected seconds")
    back = np.flatnonzero(np.diff(times) < 0)
    if back.size:
        row = int(back[0]) + 1
        raise DataError(f"stamps: row {row} goes back from {times[row - 1]} s to {times[row]} s")
    if count and np.abs(times).max() > _SECONDS:
        raise DataError(f"stamps: {times[-1]:g} s is too late; nanoseconds? Divide them by 1e9")
    return times


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
