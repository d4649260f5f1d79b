# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Precision and recall against stored curves, scikit-learn and a plain double loop."""

import json
import math
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from descriptor_runs import descriptor_run, poses_at
from error_codes import has_code
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.evaluation import (
    PROTOCOLS,
    DescriptorRun,
    EvaluationConfig,
    Matches,
    PrecisionRecall,
    evaluate,
    evaluate_matches,
    find_matches,
    kitti_sequence,
    precision_recall,
    published_figures,
    summarise_costs,
)
from fusionslam.loop_closure import default_threshold
from rows import rows

Curve = list[tuple[float, float, float]]


def places_and_descriptors(
    seed: int, count: int, levels: int = 0
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """A walk that comes back, and noisy descriptors of where it is; few levels make ties."""
    rng = np.random.default_rng(seed)
    positions = np.cumsum(rng.normal(0, 2, (count, 3)) * (1, 1, 0.1), axis=0)
    positions[count // 2 :] = positions[: count - count // 2] + rng.normal(0, 2, 3)
    descriptors = positions[:, :2] + rng.normal(0, 3, (count, 2))
    if levels:
        descriptors = np.round(descriptors / levels)
    return descriptors.astype(np.float32), positions


def nearest_by_loops(descriptors: NDArray[np.float32], window: int) -> list[tuple[int, float]]:
    found = []
    for query, wanted in enumerate(descriptors.tolist()):
        best, distance = -1, math.inf
        for candidate in range(query - window):
            there = math.dist(wanted, descriptors[candidate].tolist())
            if there < distance:
                best, distance = candidate, there
        found.append((best, float(np.float32(distance))))
    return found


def curve_by_loops(
    found: list[tuple[int, float]],
    positions: NDArray[np.float64],
    protocol: str,
    radius: float,
    window: int,
) -> Curve:
    """(threshold, precision, recall) with one pass over all queries for each threshold."""
    near = [[math.dist(a, b) < radius for b in positions] for a in positions]
    correct = [match >= 0 and near[query][match] for query, (match, _) in enumerate(found)]
    revisits = sum(any(near[query][: max(0, query - window)]) for query in range(len(positions)))
    denominator = revisits if protocol == "revisit" else sum(correct)
    rows = []
    for threshold in sorted({distance for match, distance in found if match >= 0}):
        accepted = [good for good, (_, d) in zip(correct, found, strict=True) if d <= threshold]
        recall = sum(accepted) / denominator if denominator else math.nan
        rows.append((threshold, sum(accepted) / len(accepted), recall))
    return rows


def kitti06(test_data: Path) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    poses = np.loadtxt(test_data / "kitti" / "poses" / "06.txt").reshape(-1, 3, 4)
    return np.load(test_data / "descriptors" / "kitti06_lidar_camera_m2dp.npy"), poses[:, :, 3]


def test_the_default_threshold_fitted_on_towns_is_right_on_kitti_06(test_data: Path) -> None:
    curve = precision_recall(*kitti06(test_data))
    accepted = curve.accepted(default_threshold("m2dp:author"))
    assert curve.correct[accepted].mean() > 0.9
    assert (accepted & curve.correct).sum() / curve.n_revisits > 0.5


@rows("levels", [0, 2])
def test_the_threshold_of_a_precision_is_the_largest_that_has_it(levels: int) -> None:
    curve = precision_recall(*places_and_descriptors(5, 120, levels), radius=3, window=5)
    for wanted in (0.0, 0.3, 0.5, 0.8, 1.0):
        enough = [
            float(threshold)
            for threshold in curve.thresholds
            if curve.correct[curve.accepted(float(threshold))].mean() >= wanted
        ]
        assert curve.threshold_at(wanted) == (max(enough) if enough else None)
    assert curve.threshold_at(1.1) is None


def test_both_curves_of_kitti_06_are_reproduced(test_data: Path) -> None:
    curve = precision_recall(*kitti06(test_data), protocol="perdomo2019")
    stored = test_data / "descriptors" / "kitti06_lidar_camera_m2dp.pr.csv"
    expected = np.loadtxt(stored, delimiter=",", skiprows=1)
    ours = np.column_stack([curve.recall, curve.precision])
    assert ours.shape == expected.shape
    np.testing.assert_allclose(ours, expected, rtol=5e-6, atol=0)
    assert curve.recall_at_full_precision == pytest.approx(0.668122, abs=5e-7)
    curve = precision_recall(*kitti06(test_data), protocol="revisit", radius=10)
    assert (curve.n_queries, curve.n_revisits, curve.n_correct) == (1101, 274, 229)
    figures = (curve.top1, curve.recall_at_full_precision, curve.max_f1, curve.average_precision)
    assert figures == pytest.approx((0.836, 0.558, 0.790, 0.787), abs=5e-4)
    assert curve.explain(0.0).startswith("1101 queries: 51 without candidates, 1050 above")


@rows("protocol", ["revisit", "perdomo2019"])
@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 60),
    window=st.integers(0, 30),
    levels=st.sampled_from([0, 2, 5]),
    radius=st.sampled_from([0.5, 3.0, 10.0]),
)
def test_a_curve_equals_that_of_plain_loops(
    protocol: str, seed: int, count: int, window: int, levels: int, radius: float
) -> None:
    descriptors, positions = places_and_descriptors(seed, count, levels)
    found = nearest_by_loops(descriptors, window)
    curve = precision_recall(
        descriptors, positions, protocol=protocol, radius=radius, window=window
    )
    expected = np.array(curve_by_loops(found, positions, protocol, radius, window))
    ours = np.column_stack([curve.thresholds, curve.precision, curve.recall])
    np.testing.assert_allclose(ours, expected.reshape(-1, 3), rtol=1e-6)
    assert curve.matches.tolist() == [match for match, _ in found]


def test_recall_at_k_counts_revisits_with_a_correct_one_among_the_k_nearest() -> None:
    descriptors, positions = places_and_descriptors(3, 80)
    curve = precision_recall(descriptors, positions, window=5, radius=4)
    for k, share in curve.recall_at_k.items():
        hits = 0
        for query in np.flatnonzero(curve.revisit):
            order = np.linalg.norm(descriptors[: query - 5] - descriptors[query], axis=1).argsort()
            there = np.linalg.norm(positions[order[:k]] - positions[query], axis=1)
            hits += bool((there < 4).any())
        assert share == pytest.approx(hits / curve.n_revisits)
    assert curve.recall_at_k[1] == curve.top1


def test_average_precision_is_scikit_learns_where_recall_counts_the_same_queries() -> None:
    metrics = pytest.importorskip("sklearn.metrics")
    descriptors, positions = places_and_descriptors(5, 200, levels=2)
    perdomo = precision_recall(descriptors, positions, protocol="perdomo2019", window=10)
    present = perdomo.matches >= 0
    expected = metrics.average_precision_score(
        perdomo.correct[present], -perdomo.distances[present]
    )
    assert perdomo.average_precision == pytest.approx(expected)
    revisit = precision_recall(descriptors, positions, protocol="revisit", window=10)
    share = revisit.n_correct / revisit.n_revisits
    assert revisit.average_precision == pytest.approx(expected * share)


def test_the_figures_at_chosen_thresholds_are_those_of_the_curve() -> None:
    curve = precision_recall(*places_and_descriptors(11, 150), window=10, radius=5)
    accepted = curve.accepted(curve.max_f1_threshold)
    good = (accepted & curve.correct).sum()
    assert curve.max_f1 == pytest.approx(2 * good / (accepted.sum() + curve.n_revisits))
    if curve.threshold_at_full_precision is not None:
        assert curve.correct[curve.accepted(curve.threshold_at_full_precision)].all()
    matches = Matches(
        np.array([[-1], [0], [0], [0]]), np.array([[np.inf], [1], [2], [3]], dtype=np.float32)
    )
    positions = np.array([[0, 0, 0], [99, 0, 0], [1, 0, 0], [2, 0, 0]])
    curve = evaluate_matches(matches, positions, window=0)
    assert curve.recall_at_full_precision == 0
    assert curve.threshold_at_full_precision is None


def test_without_any_revisit_the_figures_are_none_and_json_has_no_nan(tmp_path: Path) -> None:
    line = np.arange(20)[:, None] * np.array([100.0, 0, 0])
    curve = precision_recall(places_and_descriptors(0, 20)[0], line, window=3)
    figures = (curve.n_revisits, curve.top1, curve.max_f1, curve.average_precision)
    assert figures == (0, None, None, None)
    assert set(curve.recall_at_k.values()) == {None}
    curve.save(tmp_path / "curve.json")
    assert "NaN" not in (tmp_path / "curve.json").read_text()
    assert np.isnan(PrecisionRecall.load(tmp_path / "curve.json").recall).all()
    assert "undefined" in str(curve)


def test_nothing_matches_within_the_window_or_at_the_radius() -> None:
    curve = precision_recall(*places_and_descriptors(0, 5), window=50)
    assert curve.matches.tolist() == [-1] * 5
    assert curve.thresholds.size == 0
    assert curve.explain(None) == (
        "5 queries: 5 without candidates, no threshold accepts a correct match"
    )
    matches = Matches(np.array([[-1], [0]]), np.array([[np.inf], [0]], dtype=np.float32))
    apart = np.array([[0.0, 0, 0], [0, 0, 10]])
    assert evaluate_matches(matches, apart, radius=10, window=0).n_correct == 0
    assert evaluate_matches(matches, apart, radius=10.001, window=0).n_correct == 1


def test_a_saved_curve_loads_equal(tmp_path: Path) -> None:
    curve = precision_recall(*places_and_descriptors(1, 60), window=4)
    curve.save(tmp_path / "curve.json")
    loaded = PrecisionRecall.load(tmp_path / "curve.json")
    assert loaded.metrics() == curve.metrics()
    for name in ("thresholds", "precision", "recall", "queries", "matches", "distances", "revisit"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(curve, name))
        assert getattr(loaded, name).dtype == getattr(curve, name).dtype


@rows("content", ["", "{", "[]", "{}", json.dumps({"format": "other"})])
def test_a_file_that_is_no_curve_is_named(tmp_path: Path, content: str) -> None:
    (tmp_path / "curve.json").write_text(content)
    with pytest.raises(DataError, match=r"curve\.json"):
        PrecisionRecall.load(tmp_path / "curve.json")


def test_a_curve_draws_itself() -> None:
    axis = precision_recall(*places_and_descriptors(1, 60), window=4, radius=5).plot(label="ours")
    assert axis.get_lines()[0].get_label() == "ours"
    assert "revisit, 5 m" in axis.get_xlabel()


@rows(
    "change, error, words",
    [
        ({"positions": np.zeros((4, 3))}, ShapeError, r"positions.*\(5, 3\)"),
        ({"positions": np.zeros((5, 2))}, ShapeError, r"positions.*\(5, 2\)"),
        ({"positions": np.full((5, 3), np.nan)}, DataError, "positions: row 0"),
        ({"descriptors": np.zeros(5, np.float32)}, ShapeError, "descriptors"),
        ({"descriptors": np.zeros((5, 2), complex)}, ShapeError, "descriptors: complex128"),
        ({"descriptors": np.full((5, 2), np.inf, np.float32)}, DataError, "descriptors: row 0"),
        ({"radius": 0.0}, ConfigError, "evaluation.radius"),
        ({"radius": math.nan}, ConfigError, "evaluation.radius"),
        ({"window": -1}, ConfigError, "evaluation.window"),
        ({"protocol": "revisits"}, ConfigError, "revisits"),
    ],
)
def test_bad_input_is_named(change: dict[str, Any], error: type[Exception], words: str) -> None:
    good = {"descriptors": np.zeros((5, 2), np.float32), "positions": np.zeros((5, 3))}
    with pytest.raises(error, match=words):
        precision_recall(**(good | change))


def test_matches_that_the_window_excludes_or_without_a_distance_are_refused() -> None:
    matches = Matches(np.array([[-1], [0]]), np.array([[np.inf], [0]], dtype=np.float32))
    with pytest.raises(DataError, match="query 1"):
        evaluate_matches(matches, np.zeros((2, 3)), window=1)
    with pytest.raises(DataError, match="row 0"):
        Matches(np.array([[0]]), np.array([[np.inf]], dtype=np.float32))


def some_run(**change: Any) -> DescriptorRun:
    descriptors, positions = places_and_descriptors(2, 40)
    return descriptor_run(descriptors, **{"poses": poses_at(positions), **change})


def test_a_saved_run_loads_equal(tmp_path: Path) -> None:
    for run in (some_run(), some_run(poses=None)):
        run.save(tmp_path / "run.npz")
        loaded = DescriptorRun.load(tmp_path / "run.npz")
        for name in ("source", "descriptor", "dataset", "config", "peak_memory_bytes"):
            assert getattr(loaded, name) == getattr(run, name)
        for name in ("descriptors", "frames", "stamps_ns", "points", "poses"):
            np.testing.assert_array_equal(getattr(loaded, name), getattr(run, name))
        assert loaded.seconds.keys() == run.seconds.keys()
        assert [path.name for path in tmp_path.iterdir()] == ["run.npz"]


def test_other_and_damaged_files_are_no_run_and_nothing_is_said_of_pickles(tmp_path: Path) -> None:
    path, array = tmp_path / "run.npz", tmp_path / "array.npy"
    with pytest.raises(DataError, match=r"run\.npz"):
        DescriptorRun.load(path)
    np.save(array, np.zeros(3))
    some_run().save(path)
    cut = [path.read_bytes()[:kept] for kept in (0, 10, 500, 3000)]
    for content in (*cut, np.random.default_rng(0).bytes(500), array.read_bytes()):
        path.write_bytes(content)
        with pytest.raises(DataError, match=r"run\.npz") as caught:
            DescriptorRun.load(path)
        assert "pickle" not in str(caught.value)
    with pytest.raises(DataError, match=r"array\.npy"):
        DescriptorRun.load(array)


def test_a_run_whose_arrays_do_not_fit_is_refused() -> None:
    with pytest.raises(ShapeError, match="frames"):
        some_run(frames=np.arange(3))
    with pytest.raises(ShapeError, match="seconds"):
        some_run(seconds={"load": np.zeros(2)})


def test_costs_are_medians_and_percentiles_per_stage() -> None:
    costs = summarise_costs(some_run())
    assert costs.stages["load"].median_ms == pytest.approx(1)
    assert costs.stages["describe"].p95_ms == pytest.approx(19.5)
    assert costs.frame is not None and costs.frame.median_ms == pytest.approx(16)
    assert costs.bytes_per_descriptor == 8


def test_a_run_is_judged_under_every_protocol_if_its_poses_are_known() -> None:
    evaluation = evaluate(some_run(), window=5)
    assert list(evaluation.curves) == ["revisit", "perdomo2019"]
    assert evaluation.published is None  # 40 of the 1,101 frames
    assert evaluation.matches is not None and evaluation.window == 5
    evaluation = evaluate(some_run(poses=None, dataset="walk"), window=5)
    assert evaluation.curves == {} and evaluation.published is None
    assert evaluation.matches is not None and len(evaluation.matches) == 40


def test_published_figures_are_found_by_whole_sequence_source_and_descriptor() -> None:
    descriptors, _ = places_and_descriptors(2, 40)
    whole = descriptor_run(np.resize(descriptors, (1101, descriptors.shape[1])))
    assert evaluate(whole, window=5).published == {"recall_at_full_precision": 0.668122}
    known = published_figures("00", "stereo", "cm2dp", 4541)
    assert known == {"recall_at_full_precision": 0.697466}
    assert published_figures("00", "stereo", "cm2dp", 114) is None
    assert published_figures("05", "lidar", "cshot", 2761) == {
        "recall_at_full_precision": 0.708108,
        "describe_seconds": 0.1072,
    }
    assert published_figures("00", "lidar", "shot", 4541) is None
    names = ("KITTI 06", "kitti/sequences/06", "kitti07", "warehouse", "kitti_2011_09_26")
    assert [kitti_sequence(name) for name in names] == ["06", "06", "07", None, None]


def test_matches_are_the_nearest_and_first_in_either_precision() -> None:
    descriptors = np.array([[0], [1], [0], [1], [0]], dtype=np.float32)
    matches = find_matches(descriptors, window=0, k=2)
    assert matches.indices[4].tolist() == [0, 2]
    assert matches.indices[0].tolist() == [-1, -1]
    rng = np.random.default_rng(3)
    rows, places = rng.normal(size=(80, 6)).astype(np.float32), rng.uniform(0, 30, (80, 3))
    single = precision_recall(rows, places, window=5)
    double = precision_recall(rows.astype(np.float64), places, window=5)
    assert single.metrics() == double.metrics()
    with pytest.raises(DataError, check=has_code("not-finite", "descriptors", 1)):
        precision_recall(np.array([[1.0], [1e300]]), np.zeros((2, 3)))


def test_the_protocols_are_those_that_the_configuration_allows() -> None:
    allowed = get_args(EvaluationConfig.model_fields["protocol"].annotation)
    assert allowed == tuple(PROTOCOLS)
