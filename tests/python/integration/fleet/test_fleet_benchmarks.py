# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmarks of a million places and of arriving drives measure what they say."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.neighbors import NearestNeighbors

from benchmarks.fleet import million, phases
from benchmarks.fleet.drives import DATA, blocks_of, exact_distances, made, places_of, queries_of
from benchmarks.fleet.sizing import Costs, arrivals_of_day, simulate_arrivals


def test_blocks_are_the_same_whenever_they_are_made() -> None:
    (first,) = [rows for _, rows in blocks_of(made(), 3000)]
    assert (first.shape, first.dtype) == ((3000, 576), np.float32)
    assert_array_equal(first, made()(0)[:3000])
    assert [len(rows) for _, rows in blocks_of(made(), 12_000)] == [10_000, 2000]
    assert not np.array_equal(made(1)(0), made()(0))
    places = places_of(1, made()(1), 2500)
    assert len(set(places.keys)) == 2500
    assert places.keys[0] == "drive00010:10000"
    assert set(places.column("robot")) == {"r10", "r11", "r12"}


def test_exact_distances_are_those_of_scikit_learn() -> None:
    queries = queries_of("made", 4000, 20)
    peer = NearestNeighbors(n_neighbors=5, algorithm="brute").fit(made()(0)[:4000])
    distances, _ = peer.kneighbors(queries)
    assert_allclose(exact_distances(made(), 4000, queries, 5), distances, rtol=1e-4)


@pytest.mark.nightly
def test_a_small_run_gives_all_figures(tmp_path: Path) -> None:
    pytest.importorskip("lancedb", reason="the table of places is an extra")
    found = {}
    for name in phases.PHASES:
        found[name] = phases.PHASES[name](tmp_path, "made", 6000, 60)
        found[name] |= {"peak MB": 1.0, "cpu s": 1.0, "disk MB": 1.0}
    assert found["query"]["recall"] >= 0.99
    assert found["query"]["top-1"] == 1.0
    assert found["change"]["deleted"] == 1000
    text = million.tables({"made": {6000: found}})
    assert "6,000" in text


@pytest.mark.nightly
def test_real_vectors_are_driven_again(test_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FUSIONSLAM_TEST_DATA", str(test_data))
    rows = DATA["real"](0)(0)
    assert rows.shape == (10_000, 192)
    again = np.linalg.norm(rows[:100] - rows[1101:1201], axis=1)
    assert np.median(again) < np.median(np.linalg.norm(rows[:100] - rows[300:400], axis=1))


def test_exponents_are_slopes_of_logarithms(tmp_path: Path) -> None:
    sizes = {
        n: {"query": {"p50 ms": n**0.5, "p95 ms": n**0.5}, "index": {"index s": 3.0 * n}}
        for n in (10, 100, 1000)
    }
    assert million.exponent(sizes, "query", "p50 ms") == pytest.approx(0.5)
    assert million.exponent(sizes, "index", "index s") == pytest.approx(1.0)
    assert np.isnan(million.exponent(sizes, "add", "add s"))
    pytest.importorskip("matplotlib", reason="an extra draws pictures")
    million.draw(sizes, tmp_path / "growth.png")
    assert (tmp_path / "growth.png").stat().st_size > 5000


def test_bounds_that_are_missed_are_named() -> None:
    good = {"open s": 0.1, "p95 ms": 20.0, "recall": 0.99, "top-1": 0.999}
    assert not million.missed({"made": {million.MILLION: {"query": good}}})
    for change in ({"p95 ms": 20.1}, {"recall": 0.98}, {"top-1": float("nan")}):
        (line,) = million.missed({"made": {million.MILLION: {"query": good | change}}})
        assert next(iter(change)) in line


def test_waits_are_those_of_pollaczek_and_khinchine() -> None:
    # Arrivals at random and equal work: the mean wait in the queue is load / (2 (1 - load)) works.
    rng, load = np.random.default_rng(4), 0.7
    arrivals = np.cumsum(rng.exponential(1 / load, 100_000))
    waits = simulate_arrivals(arrivals, np.full(len(arrivals), 3.0), workers=3)
    assert np.mean(waits) - 1 == pytest.approx(load / (2 * (1 - load)), rel=0.03)


def test_drives_without_a_queue_wait_for_their_own_work() -> None:
    waits = simulate_arrivals(np.array([0.0, 100.0]), np.array([40.0, 20.0]), workers=4)
    assert_allclose(waits, [10, 5])


def test_a_share_of_the_drives_arrives_in_the_last_hour() -> None:
    times = arrivals_of_day(500, 4, 3, 0.5, np.random.default_rng(0))
    assert len(times) == 6000 and (np.diff(times) >= 0).all()
    late = (times % 86_400 >= 17 * 3600).mean()
    assert late == pytest.approx(0.5 + 0.5 / 10, abs=0.02)


def test_costs_grow_by_their_exponents() -> None:
    costs = Costs(0.036, 1000, 2000, 360, 2.0, 0.01, 0.5)
    assert costs.describe_core_hours(1e6) == pytest.approx(10)
    assert costs.database_gb(1e8) == pytest.approx(100)
    assert costs.clouds_gb(1e6) == pytest.approx(2)
    assert costs.build_hours(1e7) == pytest.approx(10)
    assert costs.query_ms(1e8) == pytest.approx(100)
