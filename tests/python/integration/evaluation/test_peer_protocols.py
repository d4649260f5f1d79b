# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Protocols of other papers against cases counted by hand and plain double loops."""

import math
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cli import table
from descriptor_runs import descriptor_run, poses_at
from error_codes import has_code
from fusionslam.config import merged
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.evaluation import (
    PEERS,
    PROTOCOLS,
    DescriptorRun,
    EvaluationConfig,
    Matches,
    PairRule,
    Pairs,
    PrecisionRecall,
    evaluate,
    evaluate_matches,
    evaluate_pairs,
    evaluate_verified,
    find_protocol,
    peer_figures,
    precision_recall,
    sample_pairs,
)
from fusionslam.evaluation.loops import published
from fusionslam.evaluation.loops.nearest_matches import pairwise_distances
from fusionslam.evaluation.loops.pairs import pair_distances
from fusionslam.evaluation.loops.precision_recall import sweep_thresholds
from fusionslam.report import write_report
from fusionslam.report.loops.exports import metrics_of
from fusionslam.report.loops.tables import peers_table, published_table
from rows import rows
from verified import verified_run


def on_a_line(*metres: float) -> NDArray[np.float64]:
    return np.column_stack([metres, np.zeros((len(metres), 2))])


def column(*values: float) -> NDArray[np.float32]:
    return np.array(values, dtype=np.float32)[:, None]


def a_loop(count: int = 300, seed: int = 0) -> NDArray[np.float64]:
    """Positions of two rounds of a circle 80 m across, float64 (count, 3)."""
    angles = 4 * np.pi * np.arange(count) / count
    circle = 40 * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    return circle + np.random.default_rng(seed).normal(0, 0.3, (count, 3))


def a_run(places: NDArray[np.float64], descriptor: str = "m2dp") -> DescriptorRun:
    descriptors = places + np.random.default_rng(1).normal(0, 4, (len(places), 3))
    about = {"source": "cloud", "descriptor": descriptor, "dataset": "KITTI 00"}
    return descriptor_run(descriptors, poses=poses_at(places), **about)


# Candidates are at least two frames earlier (window 1). One place, less than 3 m: (3, 0), (4, 1).
# More than 20 m apart: (2, 0), (5, 0), (5, 1), (5, 2), (5, 3). Left out: (3, 1), (4, 0), (4, 2).
PLACES = on_a_line(0, 10, 25, 1, 12, 50)
DESCRIPTORS = column(1, 11, 4, 2, 15, 2.5)


def test_pairs_are_judged_as_counted_by_hand() -> None:
    curve = evaluate_pairs(DESCRIPTORS, PLACES, window=1)
    pairs = list(zip(curve.queries.tolist(), curve.matches.tolist(), strict=True))
    near = {(3, 0), (4, 1)}
    assert set(pairs) == near | {(2, 0), (5, 0), (5, 1), (5, 2), (5, 3)}
    assert len(pairs) == len(set(pairs)) == curve.n_queries == 7
    assert [pair in near for pair in pairs] == curve.correct.tolist() == curve.revisit.tolist()
    assert curve.thresholds.tolist() == [0.5, 1, 1.5, 3, 4, 8.5]
    np.testing.assert_allclose(curve.precision, [0, 1 / 2, 1 / 4, 1 / 5, 1 / 3, 2 / 7])
    assert curve.recall.tolist() == [0, 0.5, 0.5, 0.5, 1, 1]
    assert (curve.n_revisits, curve.n_correct, curve.top1) == (2, 2, None)
    assert curve.recall_at_k == {1: None, 5: None, 10: None}
    assert (curve.max_f1, curve.max_f1_threshold) == (0.5, 1)
    assert (curve.recall_at_full_precision, curve.extended_precision) == (0, 0.5)
    assert curve.average_precision == pytest.approx(0.5 / 2 + 0.5 / 3)
    # Of the 10 pairs of a right and a false one, 4 + 1 have the right one nearer.
    assert curve.roc_auc == 0.5
    assert (curve.protocol, curve.radius, curve.window) == ("ssc", 3, 1)
    assert curve.judges_pairs and curve.counts == "7 pairs, 2 of one place"


def test_precision_recall_judges_pairs_under_their_protocol(tmp_path: Path) -> None:
    curve = precision_recall(DESCRIPTORS, PLACES, protocol="ssc", window=1)
    assert curve.metrics() == evaluate_pairs(DESCRIPTORS, PLACES, window=1).metrics()
    curve.save(tmp_path / "curve.json")
    assert PrecisionRecall.load(tmp_path / "curve.json").metrics() == curve.metrics()


def test_a_pair_with_a_descriptor_of_zeros_is_never_accepted() -> None:
    descriptors = np.concatenate([DESCRIPTORS, DESCRIPTORS], axis=1)
    descriptors[1] = 0
    curve = evaluate_pairs(descriptors, PLACES, window=1)
    lost = (curve.queries == 1) | (curve.matches == 1)
    assert np.isinf(curve.distances[lost]).all() and np.isfinite(curve.distances[~lost]).sum() > 0
    assert curve.recall[-1] == 0.5


def test_pairs_of_different_places_are_drawn_without_repetition_and_always_the_same() -> None:
    places, ssc = a_loop(), find_protocol("ssc")
    config = EvaluationConfig(protocol="ssc")
    pairs = sample_pairs(places, ssc, config)
    near, far = set(), set()
    for query, match in product(range(len(places)), repeat=2):
        metres = math.dist(places[query], places[match])
        if match < query - config.window and metres < 3:
            near.add((query, match))
        elif match < query - config.window and metres > 20:
            far.add((query, match))

    def listed(found: Pairs, same: bool) -> list[tuple[int, int]]:
        rows = found.same == same
        return list(zip(found.queries[rows].tolist(), found.matches[rows].tolist(), strict=True))

    assert len(far) < 100 * len(near)  # so that all are taken
    assert (set(listed(pairs, True)), set(listed(pairs, False))) == (near, far)
    few = replace(ssc, pairs=PairRule(far=20, negatives=2))
    drawn, same, others = (sample_pairs(places, few, config, seed) for seed in (0, 0, 1))
    assert len(listed(drawn, False)) == len(set(listed(drawn, False))) == 2 * len(near)
    assert set(listed(drawn, False)) < far and set(listed(drawn, True)) == near
    assert listed(drawn, False) == listed(same, False) != listed(others, False)
    assert (np.diff(drawn.queries) >= 0).all()


@rows("metric, length", [("l2", 7), ("scan_context", 1200)])
def test_distances_of_pairs_are_those_of_the_metric(metric: str, length: int) -> None:
    rng = np.random.default_rng(4)
    rows = rng.uniform(0, 1, (12, length)).astype(np.float32)
    queries = np.sort(rng.integers(0, 12, 40))
    pairs = Pairs(queries, rng.integers(0, 12, 40), np.zeros(40, dtype=np.bool_))
    expected = pairwise_distances(rows, metric)[pairs.queries, pairs.matches]
    np.testing.assert_allclose(pair_distances(rows, pairs, metric=metric), expected, atol=1e-6)


def roc_by_loops(distances: NDArray[np.float64], correct: NDArray[np.bool_]) -> float:
    """Area under the ROC curve by the trapezoidal rule over its points."""
    points = [(0.0, 0.0)]
    for threshold in sorted(set(distances[np.isfinite(distances)])):
        kept = distances <= threshold
        present = np.isfinite(distances)
        false = (kept & ~correct).sum() / (present & ~correct).sum()
        right = (kept & correct).sum() / (present & correct).sum()
        points.append((float(false), float(right)))
    x, y = np.array(points).T
    return float((np.diff(x) * (y[1:] + y[:-1]) / 2).sum())


@rows("seed", range(8))
def test_figures_of_the_curve_are_those_of_plain_loops(seed: int) -> None:
    rng = np.random.default_rng(seed)
    correct = rng.random(60) < 0.4
    distances = np.round(rng.normal(2, 1, 60) - correct * rng.uniform(0, 2.5), seed % 3)
    distances[rng.random(60) < 0.1] = np.inf
    figures = sweep_thresholds(distances, correct, correct)
    assert figures["roc_auc"] == pytest.approx(roc_by_loops(distances, correct))
    best = 0.0
    for threshold in set(distances[np.isfinite(distances)]):
        kept = distances <= threshold
        if correct[kept].all():
            best = max(best, float((kept & correct).sum() / correct.sum()))
    # Precision is 1 at recall 0, as in the curve of scikit-learn, which SSC's authors used.
    assert figures["extended_precision"] == pytest.approx((1 + best) / 2)


def test_without_right_or_without_false_matches_there_is_no_roc_curve() -> None:
    for correct in (np.ones(3, dtype=np.bool_), np.zeros(3, dtype=np.bool_)):
        figures = sweep_thresholds(np.arange(3.0), correct, np.ones(3, dtype=np.bool_))
        assert figures["roc_auc"] is None


def test_pairs_that_do_not_exist_are_refused() -> None:
    with pytest.raises(DataError, check=has_code("no-same-place", "3", 1)):
        evaluate_pairs(DESCRIPTORS, on_a_line(0, 10, 20, 30, 40, 50), window=1)
    with pytest.raises(DataError, check=has_code("no-other-place", "20", 1)):
        evaluate_pairs(DESCRIPTORS, on_a_line(0, 1, 2, 1, 0, 1), window=1)
    with pytest.raises(DataError, check=has_code("no-same-place", "3", 50)):
        evaluate_pairs(np.empty((0, 3), np.float32), np.empty((0, 3)))
    with pytest.raises(ConfigError, check=has_code("no-pairs", "evaluation.protocol", "revisit")):
        evaluate_pairs(DESCRIPTORS, PLACES, protocol="revisit", window=1)
    with pytest.raises(ShapeError):
        evaluate_pairs(DESCRIPTORS, PLACES[:3])
    with pytest.raises(DataError, check=has_code("not-finite", "positions", 0)):
        evaluate_pairs(DESCRIPTORS, np.full((6, 3), np.nan))
    matches = Matches(np.array([[-1], [0]]), np.array([[np.inf], [1]], dtype=np.float32))
    needs = has_code("needs-descriptors", "evaluation.protocol", "ssc")
    with pytest.raises(ConfigError, check=needs):
        evaluate_matches(matches, np.zeros((2, 3)), protocol="ssc", window=0)


def test_under_scancontext_a_place_is_less_than_4_metres_away() -> None:
    # With window 0, frame 2 is 3.9 m from frame 0 and frame 3 is 4 m from frame 1.
    places = on_a_line(0, 100, 3.9, 104)
    curve = precision_recall(column(0, 9, 0.1, 9.2), places, protocol="scancontext", window=0)
    assert (curve.radius, curve.n_revisits, curve.n_correct) == (4, 1, 1)
    assert curve.matches.tolist() == [-1, 0, 0, 1]
    assert curve.correct.tolist() == [False, False, True, False]
    own = PROTOCOLS["scancontext"]
    assert (own.radius, own.window, own.pairs, own.bound) == (4, 50, None, None)
    # Distances .1 (right), .2 (false) and 9 (false).
    assert (curve.recall_at_full_precision, curve.max_f1, curve.roc_auc) == (1, 1, 1)


def test_revisits_and_pairs_of_kitti_are_those_that_others_count(test_data: Path) -> None:
    poses = np.loadtxt(test_data / "kitti" / "poses" / "00.txt").reshape(-1, 3, 4)
    descriptors = np.arange(len(poses), dtype=np.float32)[:, None]
    curve = precision_recall(descriptors, poses[:, :, 3], protocol="scancontext")
    assert abs(curve.n_revisits - 790) <= 1  # "790 true loops": issue 12 of their repository
    poses = np.loadtxt(test_data / "kitti" / "poses" / "06.txt").reshape(-1, 3, 4)
    rows = np.load(test_data / "descriptors" / "kitti06_lidar_camera_m2dp.npy")
    curves = [evaluate_pairs(rows, poses[:, :, 3], seed=seed) for seed in (0, 1)]
    assert [curve.counts for curve in curves] == ["159277 pairs, 1577 of one place"] * 2
    assert [curve.max_f1 for curve in curves] == pytest.approx([0.531, 0.531], abs=1e-3)


def test_under_solid_the_last_hundred_frames_are_no_candidates() -> None:
    # Only the last two of 103 frames have candidates: frame 0, and frames 0 and 1.
    places = on_a_line(0, 30, *np.linspace(60, 400, 99), 9.5, 35)
    descriptors = column(0, 3, *np.full(99, 50), 1, 1.2)
    curve = precision_recall(descriptors, places, protocol="solid")
    assert (curve.radius, curve.window, curve.n_revisits) == (10, 100, 2)
    assert np.flatnonzero(curve.matches >= 0).tolist() == [101, 102]
    assert curve.correct[101:].tolist() == [True, False]
    assert (curve.top1, curve.roc_auc, curve.recall_at_full_precision) == (0.5, 1, 0.5)
    assert curve.max_f1 == pytest.approx(2 / 3)


@rows(
    "protocol, radius, window",
    [("revisit", 10, 50), ("ssc", 3, 50), ("scancontext", 4, 50), ("solid", 10, 100)],
)
def test_a_protocol_brings_its_radius_and_window(protocol: Any, radius: float, window: int) -> None:
    config = EvaluationConfig(protocol=protocol)
    assert (config.radius, config.window) == (radius, window)
    assert EvaluationConfig(protocol=protocol, radius=7.0).radius == 7
    assert merged(EvaluationConfig(protocol="ssc", window=9), {"protocol": protocol}).window == 9
    assert merged(EvaluationConfig(protocol="ssc"), {"protocol": protocol}) == config
    assert EvaluationConfig(**config.model_dump()).given() == {"protocol": protocol}
    given = {"protocol": protocol, "window": 9}
    assert EvaluationConfig(**given).given() == given


def test_each_peer_is_judged_at_its_own_radius_and_verified_loops_by_matches_alone() -> None:
    run = a_run(a_loop())
    evaluation = evaluate(run, protocols=("ssc", "scancontext", "solid"))
    own = {name: (curve.radius, curve.window) for name, curve in evaluation.curves.items()}
    assert own == {"ssc": (3, 50), "scancontext": (4, 50), "solid": (10, 100)}
    assert (
        list(evaluation.query_curves) == list(evaluation.by_direction) == ["scancontext", "solid"]
    )
    alone = precision_recall(run.descriptors, a_loop(), protocol="solid")
    assert evaluation.curves["solid"].metrics() == alone.metrics()
    given = evaluate(run, protocols=("ssc", "solid"), radius=5, window=20)
    assert {(c.radius, c.window) for c in given.curves.values()} == {(5, 20)}
    judged = evaluate_verified(verified_run(), protocols=("ssc", "solid"), window=0)
    assert list(judged.curves) == ["solid"]


def test_published_figures_are_those_that_protocols_show_of_whole_sequences() -> None:
    found = {peer.method: peer for peer in peer_figures("ssc", "08", 4071)}
    assert found["Scan Context"].figures == {"max_f1": 0.607, "extended_precision": 0.569}
    assert (found["M2DP"].descriptor, found["OverlapNet"].descriptor) == ("m2dp", None)
    assert "BoW3D" in found["M2DP"].source
    for protocol, sequence, frames in (
        ("ssc", "08", 4000),
        ("ssc", "01", 1101),
        ("ssc", None, 4071),
        ("revisit", "08", 4071),
        ("scancontext", "00", 4541),
    ):
        assert peer_figures(protocol, sequence, frames) == ()
    assert [p.method for p in peer_figures("solid", "05", 2761)] == ["Scan Context", "RING++"]
    for peer in PEERS:
        assert tuple(peer.figures) == PROTOCOLS[peer.protocol].figures
        assert all(0 <= figure <= 1 for figure in peer.figures.values())
        assert peer.sequence in published.FRAMES and peer.source
    # The extended precision is at least 1/2 by its definition.
    assert min(p.figures.get("extended_precision", 1) for p in PEERS) >= 0.5


@rows(
    "protocol, scan_context, m2dp",
    [
        ("ssc", ["0.750", "0.609"], ["0.708", "0.616"]),
        ("solid", ["0.893", "0.979", "0.876"], None),
    ],
)
def test_published_figures_stand_beside_ours(
    protocol: str,
    scan_context: list[str],
    m2dp: list[str] | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    places = a_loop()
    monkeypatch.setitem(published.FRAMES, "00", len(places))
    runs = [a_run(places), a_run(places, "shot")]
    evaluations = [evaluate(run, protocols=[protocol]) for run in runs]
    peers = peer_figures(protocol, "00", len(places))
    table = peers_table(evaluations, protocol)
    figures = {label: [cell.text for cell in cells] for label, cells in table.rows}
    assert figures["Scan Context, published"] == scan_context
    assert len(figures) == len(runs) + len(peers)
    curve = evaluations[0].curves[protocol]
    ours = [f"{getattr(curve, name):.3f}" for name in PROTOCOLS[protocol].figures]
    assert [cell.text for cell in table.rows[0][1]] == ours
    beside = published_table(evaluations, protocol)
    assert bool(beside.heads) == (m2dp is not None)
    assert [cell.text for cell in beside.rows[0][1]] == (m2dp or [])
    assert [each["method"] for each in metrics_of(evaluations[0])["peers"]] == [
        peer.method for peer in peers
    ]


@rows("protocol, last", [("scancontext", None), ("ssc", -1)])
def test_nothing_stands_beside_what_was_not_published(
    protocol: str, last: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = a_loop()
    monkeypatch.setitem(published.FRAMES, "00", len(places))
    evaluation = evaluate(a_run(places[:last]), protocols=[protocol])
    assert evaluation.peers == () and peers_table([evaluation], protocol) is None
    assert metrics_of(evaluation)["peers"] == []


def test_the_report_on_pairs_judges_no_matches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = a_loop(150)
    monkeypatch.setitem(published.FRAMES, "00", len(places))
    evaluation = evaluate(a_run(places), protocols=["ssc"])
    page = write_report(
        [evaluation], tmp_path, dataset_name="KITTI 00", command="", config={}, protocol="ssc"
    )
    text = page.read_text()
    assert evaluation.peers[0].source in text and "Scan Context, published" in text
    assert evaluation.curves["ssc"].counts in text
    rows = table(tmp_path / "matches.csv")
    assert len(rows) == 99 and {row["correct"] for row in rows} == {""}
