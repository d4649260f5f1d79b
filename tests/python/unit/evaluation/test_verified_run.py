# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Verified loops judged by their poses, against figures counted by hand."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from error_codes import has_code
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.evaluation import (
    USUAL_PROTOCOLS,
    AcceptedLoops,
    DirectionFigures,
    Matches,
    VerifiedRun,
    evaluate_matches,
    evaluate_verified,
    precision_recall,
)
from fusionslam.evaluation.loops.judge import pose_differences
from rows import rows
from verified import LOOPS, verified_run

BY_POSE = ("pose-1m-5deg", "pose-2m-5deg")
ARRAYS = (
    *("frames", "numbers", "stamps_ns", "poses", "body_from_cloud", "points", "match"),
    *("match_from_query", "covariance", "overlap", "probability", "distance", "accepted"),
    *("candidates", "rejected"),
)


@rows(
    "protocol, right, precision, recall",
    [
        ("pose-1m-5deg", (4, 7, 8), (1, 1, 2 / 3, 2 / 4, 3 / 5), (0, 0.25, 0.25, 0.25, 0.5)),
        ("pose-2m-5deg", (4, 5, 7, 8), (1, 1, 1, 3 / 4, 4 / 5), (0, 0.25, 0.5, 0.5, 0.75)),
        ("revisit", (4, 5, 6, 7), (0, 1 / 2, 2 / 3, 3 / 4, 4 / 5), (0, 0.25, 0.5, 0.75, 1)),
    ],
)
def test_the_curves_of_nine_frames_are_those_counted_by_hand(
    protocol: str, right: tuple[int, ...], precision: Any, recall: Any
) -> None:
    curve = evaluate_verified(verified_run(), window=0).curves[protocol]
    assert np.flatnonzero(curve.revisit).tolist() == [4, 5, 6, 7]
    assert np.flatnonzero(curve.correct).tolist() == list(right)
    np.testing.assert_allclose(curve.thresholds, (0.05, 0.1, 0.2, 0.3, 0.4), rtol=1e-6)
    np.testing.assert_allclose(curve.precision, precision)
    np.testing.assert_allclose(curve.recall, recall)
    full = [r for p, r in zip(precision, recall, strict=True) if p == 1]
    assert curve.recall_at_full_precision == max(full, default=0)
    assert curve.top1 == sum(query in right for query in (4, 5, 6, 7)) / 4
    assert curve.recall_at_k == {1: 0.25, 3: 1.0, 5: None, 10: None}


def test_accepted_loops_and_directions_are_those_counted_by_hand() -> None:
    evaluation = evaluate_verified(verified_run(), window=0)
    assert list(evaluation.curves) == list(USUAL_PROTOCOLS)
    assert evaluation.accepted == {
        "revisit": AcceptedLoops(3, 1, 0.5),
        "perdomo2019": AcceptedLoops(3, 1, 0.5),
        "pose-1m-5deg": AcceptedLoops(3, 1, 0.25),
        "pose-2m-5deg": AcceptedLoops(3, 0, 0.5),
    }
    assert evaluation.by_direction["pose-2m-5deg"] == {
        "same": DirectionFigures(1, top1=0, recall_at_full_precision=0, accepted=0),
        "opposite": DirectionFigures(2, top1=1, recall_at_full_precision=1, accepted=1),
        "crossing": DirectionFigures(1, top1=1, recall_at_full_precision=0, accepted=0),
    }
    assert evaluation.by_direction["pose-1m-5deg"]["opposite"].recall_at_full_precision == 0.5
    assert evaluation.costs.frame.median_ms == pytest.approx(120)


def test_a_match_without_a_pose_is_wrong_by_pose_and_right_by_place() -> None:
    run = verified_run()
    poses = run.match_from_query.copy()
    poses[4] = np.nan
    accepted = run.accepted & (np.arange(len(run)) != 4)
    found = evaluate_verified(replace(run, match_from_query=poses, accepted=accepted), window=0)
    assert not found.curves["pose-2m-5deg"].correct[4] and found.curves["revisit"].correct[4]


def test_poses_are_not_judged_where_the_body_of_the_clouds_is_not_known() -> None:
    unknown = evaluate_verified(verified_run(body_from_cloud=None), window=0)
    assert list(unknown.curves) == ["revisit", "perdomo2019"]
    assert evaluate_verified(verified_run(poses=None), window=0).curves == {}
    axes_ignored = np.tile(np.eye(4), (len(verified_run()), 1, 1))
    wrong = evaluate_verified(verified_run(body_from_cloud=axes_ignored), window=0)
    assert wrong.curves["pose-2m-5deg"].n_correct == 0


def test_the_differences_of_poses_are_those_that_were_put_in() -> None:
    rng = np.random.default_rng(4)
    count, size = 40, np.logspace(-6, 0, 40)[:, None]
    moved, turned = rng.normal(0, 1, (count, 3)) * size, rng.normal(0, 1, (count, 3)) * size
    poses = rigid(rng.normal(0, 20, (count, 3)), rng.normal(0, 2, (count, 3)))
    indices = np.maximum(np.arange(count) - 7, 0)
    estimates = np.linalg.inv(poses[indices]) @ poses @ rigid(moved, turned)
    ones = np.ones((count, 1), np.float32)
    metres, degrees = pose_differences(Matches(indices[:, None], ones, estimates[:, None]), poses)
    np.testing.assert_allclose(metres[:, 0], np.linalg.norm(moved, axis=1), atol=1e-12)
    angles = np.degrees(np.linalg.norm(turned, axis=1))
    assert angles.max() < 180
    np.testing.assert_allclose(degrees[:, 0], angles, rtol=1e-6, atol=1e-9)


def rigid(positions: NDArray[np.float64], turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Poses (n, 4, 4) of positions and rotation vectors, (n, 3) each."""
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3], poses[:, :3, :3] = positions, Rotation.from_rotvec(turns).as_matrix()
    return poses


@rows("protocol", BY_POSE)
def test_a_protocol_by_pose_needs_poses(protocol: str) -> None:
    needs = has_code("needs-poses", "evaluation.protocol", protocol)
    with pytest.raises(ConfigError, check=needs):
        precision_recall(np.eye(5, dtype=np.float32), np.zeros((5, 3)), protocol=protocol)
    run = verified_run()
    with pytest.raises(ConfigError, check=needs):  # no true orientations
        evaluate_matches(run.matches, run.positions, protocol=protocol, window=0)
    plain = Matches(run.matches.indices, run.matches.distances)
    with pytest.raises(ConfigError, check=needs):
        evaluate_matches(plain, run.poses, protocol=protocol, window=0)


def test_a_saved_run_loads_equal(tmp_path: Path) -> None:
    for run in (verified_run(), verified_run(poses=None, body_from_cloud=None, recorded=12)):
        run.save(tmp_path / "run.npz")
        loaded = VerifiedRun.load(tmp_path / "run.npz")
        for name in ARRAYS:
            np.testing.assert_array_equal(getattr(loaded, name), getattr(run, name))
        for name in ("source", "descriptors", "dataset", "config", "skipped", "recorded"):
            assert getattr(loaded, name) == getattr(run, name)
        assert loaded.seconds.keys() == run.seconds.keys()
        assert "3 loops" in repr(loaded) and "m2dp+scan_context" in repr(loaded)


def test_a_part_of_a_run_loses_the_matches_that_are_not_in_it() -> None:
    part = verified_run().only(np.array([1, 4, 5, 7]))
    assert part.match.tolist() == [-1, -1, 0, 0]
    assert part.accepted.tolist() == [False, False, True, False]
    assert np.isnan(part.match_from_query[:2]).all() and np.isnan(part.probability[1])
    assert part.candidates.tolist() == [[-1] * 3, [-1] * 3, [-1, 0, -1], [-1, -1, 0]]
    assert len(part.rejected) == 0
    assert verified_run().only(np.array([0, 4, 5])).rejected.tolist() == [
        (1, 0, "low-overlap", 0.1)
    ]
    assert evaluate_verified(part, window=0).curves["pose-2m-5deg"].n_correct == 2


def changed(name: str, row: Any, value: Any) -> dict[str, Any]:
    values = getattr(verified_run(), name).copy()
    values[row] = value
    return {name: values}


@rows(
    "name, row, value, code",
    [
        ("body_from_cloud", 3, np.zeros((4, 4)), "not-a-rotation"),
        ("match", 4, 4, "wrong-row"),
        ("match", 4, -2, "wrong-row"),
        ("candidates", (5, 2), 7, "wrong-row"),
        ("rejected", 1, (9, 1, "tilted", 9.0), "wrong-row"),
        ("probability", 4, 1.5, "wrong-match"),
        ("probability", 4, np.nan, "wrong-match"),
        ("probability", 0, 0.5, "wrong-match"),
        ("distance", 4, np.nan, "wrong-match"),
        ("distance", 0, 0.5, "wrong-match"),
        ("accepted", 0, True, "wrong-match"),
        ("match_from_query", 4, 2 * np.eye(4), "wrong-pose"),
        ("match_from_query", 0, np.eye(4), "wrong-pose"),
    ],
)
def test_values_that_do_not_fit_each_other_are_refused(
    name: str, row: Any, value: Any, code: str
) -> None:
    first = row[0] if isinstance(row, tuple) else row
    with pytest.raises(DataError, check=has_code(code, name, first)):
        verified_run(**changed(name, row, value))


@rows(
    "change",
    [
        {"overlap": np.zeros(3)},
        {"seconds": {"register": np.zeros(2)}},
        {"poses": np.zeros((9, 3))},
        {"candidates": np.zeros(9, np.int64)},
    ],
)
def test_arrays_of_other_shapes_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ShapeError):
        verified_run(**change)


def test_true_poses_or_windows_that_do_not_fit_are_refused() -> None:
    run = verified_run(**changed("poses", 2, np.diag([0.0, 0, 0, 1])))
    with pytest.raises(DataError, check=has_code("not-a-rotation", "poses", 2)):
        evaluate_verified(run, window=0)
    with pytest.raises(DataError, check=has_code("window", "lidar", 2, 2)):
        evaluate_verified(verified_run(), window=2)
    assert max(query - match for query, (match, *_) in LOOPS.items()) > 2
