# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Views judged, of whole drives, as they come and over thresholds; the published figures."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from error_codes import has_code
from fusionslam.errors import ClockError, ConfigError, DataError, ShapeError
from fusionslam.evaluation import (
    PUBLISHED_VIEWS,
    RERUN_DESCRIPTORS,
    RERUN_VIEWS,
    VIEW_RULES,
    JudgedView,
    RunningViews,
    ViewCurve,
    ViewJudge,
    ViewReport,
    ViewRule,
    always_new,
    baselines,
    every_kth,
    ids_from_pairs,
    judge_views,
    published_views,
    rerun_descriptors,
    rerun_views,
    sweep_pairs,
    sweep_views,
)
from recordings import Drive, judged_by_loops, random_drive, scans_above_floor
from rows import rows

# Nothing in the random drives lies exactly on these limits, where rounding would decide.
LIMITS = {"false_positive_distance": 0.81, "false_negative_distance": 0.21, "loop_distance": 0.81}
ANGLES = {"revisit_angle": 31.0, "false_negative_angle": 13.0}
OFF_GRID = {**LIMITS, **ANGLES, "revisit_distance": 0.51}


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.integers(1, 30), st.booleans())
def test_every_count_is_that_of_plain_loops(seed: int, count: int, views: int, lax: bool) -> None:
    drive = random_drive(seed, count, views)
    ids, poses, stamps = drive
    rule = ViewRule(**OFF_GRID, false_positive_angle=73.0 if lax else 22.9)
    report = judge_views(ids, poses, stamps, rule=rule)
    expected = judged_by_loops(drive, rule)
    assert {name: getattr(report, name) for name in expected} == expected
    assert report.true_positives + report.false_positives == report.positives
    assert report.true_negatives + report.false_negatives == count - report.positives


def test_blocks_do_not_change_a_count(monkeypatch: pytest.MonkeyPatch) -> None:
    drive = random_drive(5, 300, 40)
    whole = judge_views(*drive)
    monkeypatch.setattr("fusionslam.evaluation.views.judge._BLOCK", 7)
    assert judge_views(*drive).metrics() == whole.metrics()


def line(*xs: float) -> NDArray[np.float64]:
    return np.array([(x, 0.0, 0.0) for x in xs])


def test_a_drive_by_hand() -> None:
    """There, far away, and back twice: once known again, once taken for another place."""
    poses = line(0, 5, 0.1, 0.15, 0.1)
    report = judge_views([7, 3, 7, 3, 9], poses, [0, 10, 30, 31, 32])
    assert report.matched.tolist() == [-1, -1, 0, 1, -1]
    assert report.false_positive_indices.tolist() == [3]
    assert report.false_negative_indices.tolist() == [4]
    assert report.accuracy == pytest.approx(3 / 5)
    assert (report.loop_recall, report.loop_precision) == (pytest.approx(1 / 3), 0.5)
    assert (report.precision, report.recall) == (0.5, 0.5)
    assert report.mean_false_positive_distance == pytest.approx(4.85)
    assert report.max_false_positive_angle == 0
    assert report.views == 3


def test_a_loop_is_older_than_twenty_seconds_wherever_the_clock_starts() -> None:
    for start in np.arange(0, 3, 0.1):
        for end, loops in ((start + 20.0, 0), (start + 20.001, 1)):
            report = judge_views([0, 0], line(0, 0), [start, end])
            assert (report.revisits, report.loops) == (loops, loops)


def test_a_loop_needs_an_old_view_and_a_revisit_an_old_pose() -> None:
    """Matched to what was stored 10 s ago, where it also was 40 s ago: missed."""
    report = judge_views([0, 1, 2, 2], line(0, 9, 0.4, 0), [0, 20, 30, 40])
    assert report.revisit.tolist() == [False, False, True, True]
    assert report.loop_recall == 0 and report.loop_precision is None


@rows("turn, wrong", [(22.9, False), (23.0, True), (337.5, False)])
def test_angles_wrap_and_the_authors_are_laxer(turn: float, wrong: bool) -> None:
    poses = [[0, 0, 0], [0, 0, np.radians(turn)]]
    assert judge_views([0, 0], poses, [0, 1]).false_positives == wrong
    poses[1][2] = np.radians(71)
    assert judge_views([0, 0], poses, [0, 1], rule="author").false_positives == 0
    poses[1][2] = np.radians(73)
    assert judge_views([0, 0], poses, [0, 1], rule="author").false_positives == 1


@rows("rule, turn", [("paper", 12.0), ("author", 7.2)])
def test_a_new_view_is_wrong_within_the_rules_angle(rule: str, turn: float) -> None:
    for change, wrong in ((-0.01, 1), (0.01, 0)):
        poses = [[0, 0, 3.1], [0.19, 0, 3.1 + np.radians(turn + change)]]
        assert judge_views([0, 1], poses, [0, 1], rule=rule).false_negatives == wrong


def test_ids_may_be_any_numbers_and_negative_ones_are_never_stored() -> None:
    report = judge_views([-1, -1, 4, -1], line(0, 0, 0, 0.1), [0, 1, 2, 3])
    assert (report.n, report.views, report.unplaced, report.positives) == (4, 1, 3, 0)
    assert report.false_negative_indices.tolist() == [3]
    ids, poses, stamps = random_drive(3, 200, 25)
    renamed = np.where(ids < 0, -5, 1000 - 7 * ids)
    judge = ViewJudge(poses, stamps)
    assert judge.judge(ids).metrics() == judge.judge(renamed).metrics()


def test_a_share_of_nothing_is_none_and_is_printed_so() -> None:
    report = judge_views([], np.empty((0, 3)), [])
    figures = report.metrics()
    assert figures["n"] == 0 and figures["accuracy"] is None
    for name in ("loop_recall", "loop_precision", "precision", "recall"):
        assert figures[name] is None
    assert str(report).count("none") == 6
    json.dumps(figures, allow_nan=False)


def test_accuracy_is_never_printed_without_the_loops() -> None:
    report = judge_views([0, 0], line(0, 0.3), [0, 30])
    with pytest.raises(dataclasses.FrozenInstanceError):
        report.n = 3
    text = str(report)
    assert "accuracy         100.0 %" in text
    assert "loop recall      100.0 %   1 of 1 revisits" in text
    assert "loop precision   100.0 %" in text


@rows(
    "change, error, words",
    [
        ({"ids": [0, 1]}, ShapeError, r"ids: int64 \(2,\)"),
        ({"ids": [0.0, 1.0, 2.0]}, ShapeError, "ids: float64"),
        ({"ids": [True, False, True]}, ShapeError, "ids: bool"),
        ({"ids": np.full(3, 2**64 - 1, "u8")}, DataError, "ids: 18446744073709551615"),
        ({"poses": np.zeros((3, 2))}, ShapeError, r"poses: \(3, 2\)"),
        ({"poses": [[0, 0, 0], [0, np.nan, 0], [0, 0, 0]]}, DataError, "poses: row 1"),
        ({"poses": "far"}, ShapeError, "poses"),
        ({"stamps": [0, 1]}, ShapeError, r"stamps: \(2,\)"),
        ({"stamps": [0, 2, 1]}, DataError, "stamps: row 2"),
        ({"stamps": [0, 1, np.inf]}, DataError, "stamps: row 2"),
        ({"stamps": [10**18] * 3}, DataError, "stamps"),
    ],
)
def test_wrong_input_is_refused(change: dict[str, Any], error: type[Exception], words: str) -> None:
    good: dict[str, Any] = {"ids": [0, 1, 2], "poses": np.zeros((3, 3)), "stamps": [0, 1, 2]}
    with pytest.raises(error, match=words):
        judge_views(**(good | change))


def test_a_rule_of_ones_own_is_called_custom_and_has_limits() -> None:
    report = judge_views([0], line(0), [0], rule=ViewRule(loop_age=5))
    assert report.rule_name == "custom"
    assert judge_views([0], line(0), [0], rule=VIEW_RULES["author"]).rule_name == "author"
    for value in (-0.1, float("inf"), float("nan")):
        with pytest.raises(ValueError, match="loop_age"):
            ViewRule(loop_age=value)


def test_baselines_start_views_by_counting() -> None:
    assert always_new(3).tolist() == [0, 1, 2]
    assert every_kth(7, 3).tolist() == [0, 0, 0, 1, 1, 1, 2]
    assert all(len(ids) == 5 for ids in baselines(5).values())
    for n, k in ((3, 0), (-1, 2)):
        with pytest.raises(ConfigError):
            every_kth(n, k)


@rows("world, scans", [("warehouse", 466), ("small_house", 474)])
def test_baselines_score_what_was_measured(test_data: Path, world: str, scans: int) -> None:
    """The author's scans: those of the collision shapes that hold more than floor."""
    (elsewhere,) = (row for row in rerun_views(world) if row.input == "no sensor: new every 3rd")
    poses, stamps = scans_above_floor(test_data, world)
    report = judge_views(every_kth(len(poses), 3), poses, stamps)
    assert report.n == scans
    assert report.accuracy == pytest.approx(elsewhere.accuracy, abs=5e-4)
    assert report.loop_recall == elsewhere.loop_recall == 0 and report.loop_precision is None


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


def test_a_drive_by_hand_that_is_judged_as_it_comes() -> None:
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


def two_laps(count: int = 80) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses and stamps of a robot that goes round a circle of 3 m twice."""
    angle = np.linspace(0, 4 * np.pi, count)
    poses = np.stack([3 * np.sin(angle), 3 * np.cos(angle), -angle], axis=1)
    return poses, np.arange(count, dtype=np.float64)


def nearest_earlier(noise: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Similarity and row of each scan's nearest earlier scan, as a poor sensor sees it."""
    poses, _ = two_laps()
    rng = np.random.default_rng(3)
    seen = poses[:, :2] + rng.normal(0, noise, (len(poses), 2))
    apart = np.linalg.norm(seen[:, None] - seen[None, :], axis=2)
    apart[np.triu_indices(len(poses))] = np.inf
    candidates = np.where(np.arange(len(poses)) > 0, apart.argmin(axis=1), -1)
    return np.exp(-apart.min(axis=1)), candidates


def test_ids_follow_their_candidates_to_the_first_scene() -> None:
    similarities = [0.0, 0.9, 0.8, 0.2, 0.7]
    candidates = [-1, 0, 1, 2, 3]
    assert ids_from_pairs(similarities, candidates, 0.5).tolist() == [0, 0, 0, 1, 1]
    assert ids_from_pairs(similarities, candidates, 0.85).tolist() == [0, 0, 1, 2, 3]
    assert ids_from_pairs([np.nan], [-1], 0.5).tolist() == [0]
    # A threshold accepts what equals it.
    assert ids_from_pairs([0, 0.5], [-1, 0], 0.5).tolist() == [0, 0]


def test_every_row_of_the_curve_is_the_report_at_its_threshold() -> None:
    judge = ViewJudge(*two_laps())
    pairs = nearest_earlier(0.3)
    curve = sweep_pairs(judge, *pairs)
    assert len(curve) == len(np.unique(pairs[0][1:])) + 1
    for index, threshold in enumerate(curve.thresholds):
        report = judge.judge(ids_from_pairs(*pairs, threshold))
        assert curve.row(index) == {name: getattr(report, name) for name in curve.figures}
    assert curve.row(len(curve) - 1)["loops"] == 0


def test_a_matcher_is_run_once_a_threshold() -> None:
    judge, asked = ViewJudge(*two_laps()), []

    def matcher(threshold: float) -> NDArray[np.int64]:
        asked.append(threshold)
        return ids_from_pairs(*nearest_earlier(0.3), threshold)

    curve = sweep_views(judge, matcher, [0.9, 0.1, 0.5, 0.5])
    assert asked == [0.1, 0.5, 0.9] == curve.thresholds.tolist()


def test_the_best_threshold_keeps_the_demanded_precision() -> None:
    curve = sweep_pairs(ViewJudge(*two_laps()), *nearest_earlier(0.4))
    threshold = curve.best_threshold(0.95)
    best = curve.at(threshold)
    assert best["loop_precision"] is not None and best["loop_precision"] >= 0.95
    allowed = curve.figures["loop_precision"] >= 0.95
    assert best["loop_recall"] == curve.figures["loop_recall"][allowed].max()
    assert 0 < allowed.sum() < len(curve)
    assert curve.best_threshold(1.01) is None


def test_the_strictest_of_equal_thresholds_is_the_best_and_none_without_loops() -> None:
    judge = ViewJudge([[0, 0, 0], [0, 0, 0]], [0, 30])
    curve = sweep_pairs(judge, [0, 0.8], [-1, 0], [0.2, 0.5, 0.9])
    assert curve.best_threshold(1.0) == 0.5
    assert curve.most_accurate_threshold() == 0.5
    curve = sweep_pairs(ViewJudge([[0, 0, 0], [5, 0, 0]], [0, 1]), [0, 0.1], [-1, 0], [0.5])
    assert curve.best_threshold(0.0) is None
    assert curve.row(0)["loop_recall"] is None
    assert str(curve).count("none") == 2


def test_a_curve_is_saved_whole(tmp_path: Path) -> None:
    curve = sweep_pairs(ViewJudge(*two_laps()), *nearest_earlier(0.4))
    curve.save(tmp_path / "curve.json")
    again = ViewCurve.load(tmp_path / "curve.json")
    assert again.as_json() == curve.as_json()
    (tmp_path / "curve.json").write_text('{"format": "fusionslam.view_curve.1", "rule": "paper"}')
    with pytest.raises(DataError, match=r"curve\.json"):
        ViewCurve.load(tmp_path / "curve.json")
    with pytest.raises(DataError, match=r"none\.json"):
        ViewCurve.load(tmp_path / "none.json")


@rows(
    "change, error, words",
    [
        ({"candidates": [-1, 1]}, DataError, "candidates: row 1"),
        ({"candidates": [-1.0, 0.0]}, ShapeError, "float64"),
        ({"similarities": [0.0]}, ShapeError, r"similarities: \(1,\)"),
        ({"similarities": [0.0, np.nan]}, DataError, "similarities: row 1"),
        ({"thresholds": []}, DataError, "thresholds"),
        ({"thresholds": [np.nan]}, DataError, "thresholds"),
    ],
)
def test_pairs_that_cannot_be_are_refused(
    change: dict[str, Any], error: type[Exception], words: str
) -> None:
    good: dict[str, Any] = {"similarities": [0.0, 0.5], "candidates": [-1, 0], "thresholds": [0.5]}
    with pytest.raises(error, match=words):
        sweep_pairs(ViewJudge(np.zeros((2, 3)), [0, 1]), **(good | change))


def test_the_published_figures_stand_where_the_thesis_has_them() -> None:
    assert len(PUBLISHED_VIEWS) == 9
    house = {figures.method: figures for figures in published_views("small_house")}
    assert house["RatSLAM"].accuracy == pytest.approx(0.4125) and house["RatSLAM"].views == 445
    assert house["both stages"].build_ms == 88.265 and house["both stages"].view_bytes == 1152
    assert published_views("warehouse")[0].max_error == 3.06
    assert published_views("kitchen") == ()
    for measured in (RERUN_VIEWS, RERUN_DESCRIPTORS):
        keys = [(row.world, row.input) for row in measured]
        assert len(set(keys)) == len(keys) and len(keys) % 3 == 0
    assert rerun_descriptors("hospital")[0].top1 == pytest.approx(0.844)
    assert rerun_views("warehouse")[-1].best_loop_recall == pytest.approx(0.89)
