# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Views judged while they come, against the judge of whole drives and against plain loops."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from error_codes import has_code
from fusionslam.errors import ClockError, ConfigError, DataError, ShapeError
from fusionslam.evaluation import (
    JudgedView,
    RunningViews,
    ViewReport,
    every_kth,
    judge_views,
)
from recordings import Drive, random_drive
from rows import rows

EPOCH = 1_700_000_000_000_000_000


def same(one: ViewReport, other: ViewReport) -> bool:
    """Whether two reports are equal in every field, arrays and their types included."""
    pairs = [
        (getattr(one, field.name), getattr(other, field.name))
        for field in dataclasses.fields(ViewReport)
    ]
    return all(
        a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        if isinstance(a, np.ndarray)
        else a == b
        for a, b in pairs
    )


def nanoseconds(drive: Drive, start: int = 0) -> list[int]:
    return [start + round(seconds * 1e9) for seconds in drive[2]]


def add_drive(running: RunningViews, drive: Drive, start: int = 0) -> list[JudgedView]:
    ids, poses, _ = drive
    stamps = nanoseconds(drive, start)
    rows = zip(stamps, ids.tolist(), poses, strict=True)
    return [running.add(*row) for row in rows]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.integers(1, 30), st.booleans())
def test_after_every_scan_it_says_what_the_judge_says(
    seed: int, count: int, views: int, lax: bool
) -> None:
    ids, poses, stamps = random_drive(seed, count, views)
    rule = "author" if lax else "paper"
    running = RunningViews(rule)
    assert same(running.report(), judge_views([], np.empty((0, 3)), [], rule=rule))
    for scan in range(count):
        running.add(round(stamps[scan] * 1e9), int(ids[scan]), poses[scan])
        until = slice(scan + 1)
        expected = judge_views(ids[until], poses[until], stamps[until], rule=rule)
        assert same(running.report(), expected)
    assert len(running) == count


def test_on_a_long_drive_it_is_the_judge_of_the_drive() -> None:
    """Three laps at 2 Hz, with the stamps of a clock that counts from 1970."""
    angle = np.linspace(0, 6 * np.pi, 480)
    offsets = np.random.default_rng(1).normal(0, 0.1, (480, 3))
    poses = np.column_stack([4 * np.cos(angle), 3 * np.sin(angle), angle]) + offsets
    random = np.random.default_rng(2).integers(-1, 120, len(poses))
    for ids in (random, every_kth(len(poses), 3)):
        running = RunningViews()
        whole_ns = EPOCH + 500_000_000 * np.arange(len(poses))
        for scan in range(len(poses)):
            running.add(int(whole_ns[scan]), int(ids[scan]), poses[scan])
            if scan % 50 == 0 or scan == len(poses) - 1:
                until = slice(scan + 1)
                whole = judge_views(ids[until], poses[until], whole_ns[until] / 1e9)
                assert same(running.report(), whole)
        assert running.report().revisits > 100
    # More scans than there was room for change nothing.
    drive = random_drive(8, 2100, 90)
    running = RunningViews()
    add_drive(running, drive)
    assert same(running.report(), judge_views(*drive))


def test_each_scan_is_told_what_the_report_says_of_it() -> None:
    drive = random_drive(4, 200, 40)
    running = RunningViews()
    judged, report = add_drive(running, drive, EPOCH), running.report()
    stamps = nanoseconds(drive, EPOCH)
    for scan, one in enumerate(judged):
        assert (one.scan, one.stamp_ns, one.id) == (scan, stamps[scan], report.ids[scan])
        for name in ("false_positive", "false_negative", "revisit", "loop", "loop_correct"):
            assert getattr(one, name) is bool(getattr(report, name)[scan])
        matched = int(report.matched[scan])
        assert one.matched == (matched if matched >= 0 else None)
        if one.matched is None:
            assert one.matched_stamp_ns is one.distance is one.angle is None
        else:
            assert one.matched_stamp_ns == stamps[one.matched] and judged[one.matched].is_first
            assert (one.distance, one.angle) == (report.distances[scan], report.angles[scan])
    assert sum(one.is_first for one in judged) == report.views
    assert any(one.loop_correct for one in judged) and any(one.false_negative for one in judged)


def test_a_drive_by_hand() -> None:
    """Known again nearby, taken for another place, and nothing recognised."""
    running = RunningViews()
    first = running.add(0, 7, (0, 0, 0))
    assert first.is_first and not (first.false_positive or first.false_negative)
    running.add(10_000_000_000, 3, (5, 0, 0))
    right = running.add(30_000_000_000, 7, (0.3, 0.4, np.radians(10)))
    assert (right.matched, right.matched_stamp_ns, right.loop, right.loop_correct) == (0, 0, 1, 1)
    assert (right.distance, right.angle) == (pytest.approx(0.5), pytest.approx(10))
    wrong = running.add(31_000_000_000, 3, (0.1, 0, 0))
    assert wrong.false_positive and wrong.loop and not wrong.loop_correct and wrong.revisit
    nothing = running.add(32_000_000_000, -1, (9, 9, 0))
    assert nothing.matched is None and not nothing.is_first
    assert running.report().accuracy == pytest.approx(4 / 5)


def test_a_clock_that_goes_back_is_refused_and_changes_nothing() -> None:
    running = RunningViews()
    running.add(EPOCH, 0, (0, 0, 0))
    before = running.report()
    with pytest.raises(ClockError):
        running.add(EPOCH - 2_500_000_000, 1, (0, 0, 0))
    assert same(running.report(), before) and len(running) == 1
    assert running.add(EPOCH, 0, (0, 0, 0)).matched == 0  # the same time again is none
    with pytest.raises(ConfigError, check=has_code("unknown-rule", "papre")):
        RunningViews("papre")


@rows(
    "change, error, words",
    [
        ({"pose": (0, np.nan, 0)}, DataError, "poses: row 0"),
        ({"pose": (0, 1)}, ShapeError, r"poses: \(1, 2\)"),
        ({"pose": "here"}, ShapeError, "poses"),
        ({"view_id": 1.5}, ShapeError, "ids: float64"),
        ({"view_id": True}, ShapeError, "ids: bool"),
        ({"view_id": 2**63}, DataError, "ids: 9223372036854775808"),
        ({"view_id": 2**70}, ShapeError, "ids: object"),
        ({"stamp_ns": 12.5}, ShapeError, "stamp_ns"),
        ({"stamp_ns": 10**400}, ShapeError, "stamp_ns"),
        ({"stamp_ns": 2**64 - 1}, ShapeError, "stamp_ns"),
        ({"stamp_ns": 2**63 - 1}, DataError, "stamps"),
    ],
)
def test_wrong_views_are_refused_and_change_nothing(
    change: dict[str, Any], error: type[Exception], words: str
) -> None:
    running = RunningViews()
    running.add(5, 4, (1, 2, 3))
    before = running.report()
    good: dict[str, Any] = {"stamp_ns": 6, "view_id": 5, "pose": (1, 2, 3)}
    with pytest.raises(error, match=words):
        running.add(**(good | change))
    assert same(running.report(), before)
    assert running.add(**good).false_negative
