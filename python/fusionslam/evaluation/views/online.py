# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Judge view ids while a robot drives, one call per scan.

running = RunningViews()
judged = running.add(stamp_ns, match.id, (x, y, yaw))
if judged.false_positive:
    print(f"taken for scan {judged.matched}, which is {judged.distance:.1f} m away")
print(running.report())
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fusionslam.base.argument_types import checked
from fusionslam.evaluation.views.judge import (
    TrueScans,
    validate_ids,
    validate_poses,
    validate_stamps,
    whole_nanoseconds,
)
from fusionslam.evaluation.views.report import ViewReport
from fusionslam.evaluation.views.rules import ViewRule, view_rule
from fusionslam.sensors.messages import next_stamp

_REPORTED: list[tuple[str, type]] = [
    ("ids", np.int64),
    ("matched", np.int64),
    ("distances", np.float64),
    ("angles", np.float64),
    ("false_positive", np.bool_),
    ("false_negative", np.bool_),
    ("revisit", np.bool_),
    ("loop", np.bool_),
    ("loop_correct", np.bool_),
]
_ROW = np.dtype([("stamp_ns", np.int64), ("time", np.int64), ("pose", np.float64, 3), *_REPORTED])
_ROOM = 1024


@dataclass(frozen=True)
class JudgedView:
    """Judgement of one scan's id, as in ``ViewReport``.

    Attributes:
        scan: its number, starting at 0.
        stamp_ns: its time stamp.
        id: as given.
        false_positive: known, but too far from the first scan with this id.
        false_negative: new, although a stored scene is within reach.
        revisit: the robot returns to an older true pose.
        loop: known, and the first scan with this id is old.
        loop_correct: a loop, and near that scan.
        matched: number of the first scan with this id; None if the id is new or negative.
        matched_stamp_ns: time stamp of that scan.
        distance, angle: metres and degrees to it.
    """

    scan: int
    stamp_ns: int
    id: int
    false_positive: bool
    false_negative: bool
    revisit: bool
    loop: bool
    loop_correct: bool
    matched: int | None = None
    matched_stamp_ns: int | None = None
    distance: float | None = None
    angle: float | None = None

    @property
    def is_first(self) -> bool:
        """Whether this scan is its view's first, whose image later scans are compared with."""
        return self.matched is None and self.id >= 0


@checked
class RunningViews:
    """Judges each view as it arrives; ``report`` is ``judge_views`` of all so far.

    Memory grows by about 90 bytes a scan, and the time of a call with the number of scans: it
    compares the scan's pose with all older ones. If the clock goes back, older poses belong to
    another drive: start a new object.

    Args:
        rule: as for ``judge_views``.

    Raises:
        ConfigError: unknown rule.
    """

    def __init__(self, rule: str | ViewRule = "paper") -> None:
        self.rule_name, self.rule = view_rule(rule)
        self._rows = np.empty(_ROOM, _ROW)
        self._count = 0
        self._first: dict[int, int] = {}

    def __len__(self) -> int:
        """Number of scans."""
        return self._count

    def add(self, stamp_ns: int, view_id: int, pose: ArrayLike) -> JudgedView:
        """Judge the next scan.

        Args:
            stamp_ns: its time stamp, not before that of the previous scan.
            view_id: the recognised view; negative for none.
            pose: its true x, y in metres and yaw in radians.

        Raises:
            ClockError: a stamp before that of the previous scan.
            DataError, ShapeError: as ``judge_views``. Nothing is added if this raises.
        """
        scan = self._count
        last = int(self._rows["stamp_ns"][scan - 1]) if scan else None
        stamp = next_stamp(stamp_ns, last)
        seconds, poses = validate_stamps([stamp / 1e9], 1), validate_poses([pose])
        if scan == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows["stamp_ns"][scan] = stamp
        self._rows["time"][scan] = whole_nanoseconds(seconds)[0]
        self._rows["pose"][scan] = poses[0]
        view = int(validate_ids([view_id], 1)[0])
        first = self._first.setdefault(view, scan) if view >= 0 else -1
        self._count += 1
        rows = self._rows[: self._count]
        truth = TrueScans(self.rule, rows["pose"], rows["time"])
        this, earlier = np.array([scan]), rows[:scan]
        stored = np.flatnonzero((earlier["matched"] < 0) & (earlier["ids"] >= 0))
        found = truth.judge(this, np.array([first]), stored)
        found |= {"ids": np.array([view]), "revisit": truth.revisits(this)}
        for name, values in found.items():
            rows[name][scan] = values[0]
        return self._make_judgement(scan)

    def report(self) -> ViewReport:
        """Return the report on all ids so far."""
        rows = self._rows[: self._count]
        columns: dict[str, Any] = {name: rows[name].copy() for name, _ in _REPORTED}
        return ViewReport(
            n=self._count,
            views=len(self._first),
            unplaced=int((rows["ids"] < 0).sum()),
            rule_name=self.rule_name,
            rule=self.rule,
            **columns,
        )

    def _make_judgement(self, scan: int) -> JudgedView:
        row = dict(zip(_ROW.names or (), self._rows[scan].tolist(), strict=True))
        match: dict[str, Any] = {}
        if (matched := row["matched"]) >= 0:
            stamp_ns = int(self._rows["stamp_ns"][matched])
            match = {"matched": matched, "matched_stamp_ns": stamp_ns}
            match |= {"distance": row["distances"], "angle": row["angles"]}
        verdicts = {name: row[name] for name, kind in _REPORTED if kind is np.bool_}
        return JudgedView(scan, row["stamp_ns"], row["ids"], **verdicts, **match)
