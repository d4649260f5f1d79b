# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Views over thresholds, and the published figures that stand beside them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fusionslam.errors import DataError, ShapeError
from fusionslam.evaluation import (
    PUBLISHED_VIEWS,
    RERUN_DESCRIPTORS,
    RERUN_VIEWS,
    ViewCurve,
    ViewJudge,
    ids_from_pairs,
    published_views,
    rerun_descriptors,
    rerun_views,
    sweep_pairs,
    sweep_views,
)
from rows import rows


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
