# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scene sets keep odometry, by which whole drives are matched, and reports show the belief."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli import fails, succeeds
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.evaluation import ViewRun
from fusionslam.pipelines.views import odometry_of, run_views
from fusionslam.report import write_view_report
from fusionslam.views.matcher import ViewMatcher
from fusionslam.views.scene_recorder import SceneRecorder
from fusionslam.views.scene_set import SceneSet
from refusals import refuses
from rows import rows
from scenes import drive, matcher, place

THERE_AND_BACK = (0, 1, 2, 3, 4, 5, 6, 5, 4, 3, 2, 1, 0)
LOOKS = (0, 1, 2, 3, 1, 2, 4)
"""What the places along a corridor look like: two of them twice."""
APART = 4.0


def corridor(odometry: bool = True) -> SceneSet:
    """There and back along a corridor; odometry begins elsewhere and is 2 % too long."""
    scenes = drive([LOOKS[place] for place in THERE_AND_BACK])
    x = APART * np.array(THERE_AND_BACK)
    poses = np.stack([x, 0 * x, 0 * x], axis=1)
    measured = np.stack([0 * x - 7, 1.02 * x + 3, 0 * x + np.pi / 2], axis=1)
    return replace(scenes, poses=poses, odometry=measured if odometry else None)


@rows("kind", [None, "recorded", "drift"])
def test_a_corridor_of_look_alike_places_is_matched_by_odometry(kind: str | None) -> None:
    scenes, one = corridor(), ViewMatcher()
    run = run_views(scenes, one, odometry=odometry_of(scenes, one, kind))
    assert run.ids.tolist() == list(THERE_AND_BACK) and run.follows_odometry


def test_without_odometry_look_alike_places_are_taken_for_one() -> None:
    scenes, one = corridor(), ViewMatcher()
    alone = run_views(scenes, one, odometry=odometry_of(scenes, one, "none"))
    assert alone.ids.tolist() != list(THERE_AND_BACK) and not alone.follows_odometry


def test_a_set_keeps_its_odometry(tmp_path: Path) -> None:
    scenes = corridor()
    scenes.save(tmp_path / "set.npz")
    kept = SceneSet.load(tmp_path / "set.npz")
    np.testing.assert_array_equal(kept.odometry, scenes.odometry)
    some = kept.subset(np.array([1, 3]))
    assert some.odometry is not None and scenes.odometry is not None
    np.testing.assert_array_equal(some.odometry, scenes.odometry[[1, 3]])
    corridor(odometry=False).save(tmp_path / "set.npz")
    assert SceneSet.load(tmp_path / "set.npz").odometry is None
    with pytest.raises(ShapeError, match="odometry"):
        replace(scenes, odometry=np.zeros((2, 3)))


def test_a_recorder_takes_odometry_where_it_is_known() -> None:
    recorder, bare = SceneRecorder("a drive"), SceneRecorder("another")
    for k, odometry in enumerate([None, (1.0, 2.0, 0.1), None]):
        recorder.add(k, place(k), (0.0, 0.0, 0.0), odometry)
        bare.add(k, place(k), (0.0, 0.0, 0.0))
    assert bare.scene_set().odometry is None
    kept = recorder.scene_set().odometry
    np.testing.assert_array_equal(kept, [[np.nan] * 3, [1, 2, 0.1], [np.nan] * 3])
    with pytest.raises(DataError):
        recorder.add(3, place(3), (0.0, 0.0, 0.0), (np.inf, 0.0, 0.0))
    assert len(recorder) == 3


def test_odometry_that_is_unknown_for_a_while_is_no_reason_to_stop() -> None:
    scenes, matcher = corridor(), ViewMatcher()
    assert scenes.odometry is not None
    scenes.odometry[4] = np.nan
    run = run_views(scenes, matcher, odometry=odometry_of(scenes, matcher))
    assert len(run.ids) == len(THERE_AND_BACK)
    assert "may be anywhere" in run.matches[4].reason
    assert run.ids[:4].tolist() == [0, 1, 2, 3]


@rows("values", [{"method": "objects"}, {"odometry": False}])
def test_a_matcher_without_filter_uses_no_odometry(values: dict[str, Any]) -> None:
    assert odometry_of(corridor(), matcher(**values)) is None
    with refuses("no-filter", error=ConfigError):
        odometry_of(corridor(), matcher(**values), "recorded")


def test_a_set_without_odometry_is_matched_without() -> None:
    bare = corridor(odometry=False)
    assert odometry_of(bare, ViewMatcher()) is None
    with refuses("no-odometry"):
        odometry_of(bare, ViewMatcher(), "recorded")
    with pytest.raises(DataError):
        odometry_of(replace(bare, poses=None), ViewMatcher(), "drift")


def doubtful_run() -> ViewRun:
    """The robot is carried to a place that looks like two."""
    scenes, matcher = corridor(), ViewMatcher()
    assert scenes.odometry is not None
    scenes.odometry[8:] += [50.0, 0.0, 0.0]
    run = run_views(scenes, matcher, odometry=odometry_of(scenes, matcher))
    return run.with_truth("by odometry")


def test_a_run_holds_the_belief_and_why_answers_were_held_back(tmp_path: Path) -> None:
    run = doubtful_run()
    assert run.known is not None and run.others is not None
    assert ((run.known >= 0) & (run.others >= 0) & (run.known + run.others <= 1 + 1e-9)).all()
    (row, reason), *_ = run.held_back
    assert row == 8 and "the robot is lost" in reason and run.ids[8] == -1
    # Two places look like this one, and neither is more probable.
    assert run.known[8] < 0.6 and run.others[8] > 0.3
    run.save(tmp_path / "run.npz")
    kept = ViewRun.load(tmp_path / "run.npz")
    np.testing.assert_array_equal(kept.known, run.known)
    assert [tuple(each) for each in kept.held_back] == [tuple(each) for each in run.held_back]


def test_the_report_shows_the_belief(tmp_path: Path) -> None:
    text = write_view_report(doubtful_run(), tmp_path).read_text(encoding="utf-8")
    assert "Answers that were held back" in text and "the robot is lost" in text
    assert len([*tmp_path.glob("views_belief_*.png")]) == 1


def test_the_report_of_scans_alone_shows_no_belief(tmp_path: Path) -> None:
    alone = run_views(corridor(), ViewMatcher()).with_truth("alone")
    text = write_view_report(alone, tmp_path).read_text(encoding="utf-8")
    assert "held back" not in text and not [*tmp_path.glob("views_belief_*.png")]


def test_the_command_takes_the_odometry_of_a_set_unless_told_otherwise(tmp_path: Path) -> None:
    corridor().save(tmp_path / "set.npz")
    corridor(odometry=False).save(tmp_path / "bare.npz")
    options = ("-o", tmp_path / "out", "--no-report")
    said = succeeds("views", "match", tmp_path / "set.npz", *options).stdout
    assert "weighed by odometry: 0 ambiguous" in said
    said = succeeds("views", "match", tmp_path / "set.npz", *options, "--odometry", "none").stdout
    assert "weighed by odometry" not in said
    wanted = (*options, "--odometry", "recorded")
    assert "has no odometry" in fails(1, "views", "match", tmp_path / "bare.npz", *wanted)
