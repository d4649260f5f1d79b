# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The distances of every metric are those of their definitions, written in NumPy and SciPy."""

import pickle
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import cdist, cityblock, euclidean

from fusionslam import (
    ConfigError,
    DataError,
    DescriptorIndex,
    ShapeError,
    compare_descriptors,
    compare_scan_contexts,
    metric_names,
    nearest,
    nearest_causal,
)
from fusionslam.evaluation.loops.nearest_matches import match_described, pairwise_distances
from rows import rows

Row = NDArray[np.float32]
Wide = NDArray[np.float64]


def chi_square(a: Wide, b: Wide) -> float:
    filled = a + b > 0
    return float((((a - b) ** 2)[filled] / (a + b)[filled]).sum())


def blocks(row: Wide, size: int) -> list[Wide]:
    return [block for block in row.reshape(-1, size) if block.any()]


def regions(a: Wide, b: Wide) -> float:
    return min(
        1 - (1 + np.minimum(x, y).sum()) / (1 + np.maximum(x, y).sum())
        for x in blocks(a, 308)
        for y in blocks(b, 308)
    )


def nearest_of_set(a: Wide, b: Wide) -> float:
    return float(cdist(blocks(a, len(a) // 4), blocks(b, len(b) // 4)).min())


def unit_columns(row: Wide, columns: int) -> Wide:
    """(columns, bins), each column of unit length or zero."""
    table = row.reshape(columns, -1)
    lengths = np.linalg.norm(table, axis=1, keepdims=True)
    return np.divide(table, lengths, out=np.zeros_like(table), where=lengths > 0)


def mean_cosine(a: Wide, b: Wide, filled: float) -> float:
    return float((a * b).sum() / filled) if filled else 0.0


def fuller(a: Wide, b: Wide, columns: int) -> int:
    return max(int(row.reshape(columns, -1).any(axis=1).sum()) for row in (a, b))


def shifted_cosine(a: Wide, b: Wide, shifts: Iterable[int]) -> float:
    """The largest mean cosine of 60 columns, those of the first moved to lower numbers."""
    x, y = unit_columns(a, 60), unit_columns(b, 60)
    return max(mean_cosine(np.roll(x, -n, 0), y, fuller(a, b, 60)) for n in shifts)


def scan_context(a: Wide, b: Wide) -> float:
    return 1 - shifted_cosine(a, b, range(60))


def aligned_polar(a: Wide, b: Wide) -> float:
    key_a, key_b = (np.abs(row.reshape(60, -1)).sum(axis=1) for row in (a, b))
    coarse = int(np.argmin([np.linalg.norm(np.roll(key_a, -n) - key_b) for n in range(60)]))
    return 1 - shifted_cosine(a, b, range(coarse - 6, coarse + 7))


def moved(table: Wide, columns: int) -> Wide:
    """Shifted to lower numbers; zeros come from outside."""
    result = np.zeros_like(table)
    for column in range(len(table)):
        if 0 <= column + columns < len(table):
            result[column] = table[column + columns]
    return result


def aligned_cartesian(a: Wide, b: Wide) -> float:
    keys = (np.abs(row.reshape(40, -1)).sum(axis=1) for row in (a, b))
    key_a, key_b = (np.concatenate([key, np.zeros(40)]) for key in keys)
    coarse = int(np.argmin([np.linalg.norm(np.roll(key_a, -n) - key_b) for n in range(80)]))
    x, y = unit_columns(a, 40), unit_columns(b, 40)
    near = [(n + 40) % 80 - 40 for n in range(coarse - 4, coarse + 5)]
    return 1 - max(mean_cosine(moved(x, n), y, fuller(a, b, 40)) for n in near)


def intensity_scan_context(a: Wide, b: Wide) -> float:
    x, y = a.reshape(60, -1) > 0, b.reshape(60, -1) > 0
    alike = [float((np.roll(x, -n, 0) == y).mean()) for n in range(60)]
    turn = int(np.argmax(alike))
    return 1 - alike[turn] * shifted_cosine(a, b, range(turn - 1, turn + 2))


def iris(a: Wide, b: Wide) -> float:
    words = (row.astype("<u2").reshape(360, 2, -1).view(np.uint8) for row in (a, b))
    tables = (np.unpackbits(table, axis=2).astype(bool) for table in words)
    (code_a, mask_a), (code_b, mask_b) = ((table[:, 0], table[:, 1]) for table in tables)
    shares = [1.0]
    for turn in range(360):
        valid = np.roll(mask_a, turn, 0) & mask_b
        if valid.any():
            shares.append(float((np.roll(code_a, turn, 0) ^ code_b)[valid].mean()))
    return min(shares)


def ring(a: Wide, b: Wide) -> float:
    if not a.any() or not b.any():
        return 1.0
    x, y = (np.fft.fft(row.reshape(120, -1), axis=0) for row in (a, b))
    correlation = np.fft.ifft((x * y.conj()).sum(axis=1)).real
    return float(1 - correlation.max() / np.linalg.norm(a) / np.linalg.norm(b))


DISTANCES: dict[str, tuple[int, Callable[[Wide, Wide], float]]] = {
    "l2": (12, euclidean),
    "l1": (12, cityblock),
    "chi_square": (12, chi_square),
    "regions": (3 * 308, regions),
    "nearest_of_set": (4 * 5, nearest_of_set),
    "scan_context": (60 * 4, scan_context),
    "aligned_polar": (60 * 4, aligned_polar),
    "aligned_cartesian": (40 * 4, aligned_cartesian),
    "intensity_scan_context": (60 * 4, intensity_scan_context),
    "iris": (360 * 10, iris),
    "ring": (120 * 4, ring),
}


def random_rows(metric: str, count: int, seed: int = 0) -> Row:
    """Rows that the metric takes, with absent parts and equal rows among them."""
    rng = np.random.default_rng(seed)
    length = 66 * 9 if metric == "votes" else DISTANCES[metric][0]
    if metric == "iris":
        return rng.integers(0, 65536, (count, length)).astype(np.float32)
    rows = rng.uniform(0.1, 9, (count, length)) * (rng.uniform(size=(count, length)) < 0.4)
    size = {"regions": 308, "nearest_of_set": 5, "votes": 66}.get(metric, 4)
    parts = rows.reshape(count, -1, size)
    parts[:, 1:] *= rng.uniform(size=(count, length // size - 1, 1)) < 0.7
    rows[:, 0] = 1
    rows[count // 2] = rows[count // 3]
    return rows.astype(np.float32)


def index_of(rows: Row, metric: str, window: int = 0) -> DescriptorIndex:
    index = DescriptorIndex(rows.shape[1], window=window, metric=metric)
    for row in rows:
        index.add(row)
    return index


def test_every_metric_is_tested_and_keeps_its_number() -> None:
    assert set(metric_names()) == {*DISTANCES, "votes"}
    # Index files hold the number.
    numbered = (
        "l2 scan_context l1 chi_square regions nearest_of_set votes aligned_polar "
        "aligned_cartesian intensity_scan_context iris ring"
    )
    assert metric_names()[:12] == tuple(numbered.split())


@rows("metric", DISTANCES)
def test_the_distance_of_two_is_that_of_its_definition(metric: str) -> None:
    table, distance_of = random_rows(metric, 2 if metric == "iris" else 8), DISTANCES[metric][1]
    for query in table:
        for match in table:
            distance, _ = compare_descriptors(query, match, metric)
            expected = distance_of(query.astype(float), match.astype(float))
            assert distance == pytest.approx(expected, rel=1e-5, abs=1e-6)
        assert compare_descriptors(query, query, metric)[0] == pytest.approx(0, abs=1e-6)


@rows("metric", DISTANCES)
def test_the_neighbours_are_those_of_the_definition(metric: str) -> None:
    count = 5 if metric == "iris" else 12
    table, distance_of = random_rows(metric, count, seed=1), DISTANCES[metric][1]
    wide = table.astype(float)
    apart = np.array(
        [[distance_of(a, b) for b in wide[:n]] + [np.inf] * (count - n) for n, a in enumerate(wide)]
    )  # of earlier rows alone
    for window in (0, 3):
        indices, distances = nearest_causal(table, window=window, k=3, metric=metric)
        index = DescriptorIndex(table.shape[1], window=window, metric=metric)
        for number, row in enumerate(table):
            older = apart[number, : max(number - window, 0)]
            found = index.query(row, k=3)
            size = min(3, len(older))
            assert found[1] == pytest.approx(np.sort(older)[:3], rel=1e-5, abs=1e-6)
            assert older[found[0]] == pytest.approx(found[1], rel=1e-5, abs=1e-6)
            assert indices[number].tolist() == [*found[0], *[-1] * (3 - size)]
            assert distances[number, :size].tobytes() == found[1].tobytes()
            index.add(row)


@rows("metric", metric_names())
def test_equal_rows_go_to_the_lowest_number(metric: str) -> None:
    table = np.repeat(random_rows(metric, 4, seed=2)[:1], 5, axis=0)
    indices, distances = nearest(table[:1], table, k=5, metric=metric)
    assert indices.tolist() == [[0, 1, 2, 3, 4]]
    assert distances == pytest.approx(np.zeros((1, 5)), abs=1e-6) or metric == "votes"


@rows("metric", metric_names())
def test_threads_files_and_pickles_change_no_byte(metric: str, tmp_path: Path) -> None:
    table = random_rows(metric, 20, seed=3)
    results = {
        tuple(part.tobytes() for part in nearest(table, table, k=7, threads=threads, metric=metric))
        for threads in (1, 2, 3)
    }
    assert len(results) == 1
    index = index_of(table, metric)
    index.save(tmp_path / "places.index")
    expected = index.query(table[5], k=20)
    loaded = DescriptorIndex.load(tmp_path / "places.index")
    for other in (loaded, pickle.loads(pickle.dumps(index))):
        assert other.metric == metric and other.dimension == table.shape[1]
        for a, b in zip(expected, other.query(table[5], k=20), strict=True):
            assert a.tobytes() == b.tobytes()


def count_votes(query: Row, candidates: Row) -> NDArray[np.int64]:
    """Of each candidate the votes that agree, by the rule that the documentation states."""

    def keypoints(row: Row) -> Wide:
        return np.array(blocks(row.astype(float), 66))

    stored = [
        (place, number, point)
        for place, row in enumerate(candidates)
        for number, point in enumerate(keypoints(row))
    ]
    known = np.array([point for _, _, point in stored])
    votes: dict[int, list[tuple[int, int, Wide, Wide]]] = {}
    for number, point in enumerate(keypoints(query)):
        squares = ((known[:, :64] - point[:64]) ** 2).sum(axis=1)
        for near in np.argsort(squares, kind="stable")[:5]:
            place, other, match = stored[near]
            votes.setdefault(place, []).append((number, other, point[64:], match[64:]))

    def agree(a: tuple[int, int, Wide, Wide], b: tuple[int, int, Wide, Wide]) -> bool:
        lengths = float(np.linalg.norm(a[2] - b[2])), float(np.linalg.norm(a[3] - b[3]))
        return a[0] != b[0] and a[1] != b[1] and abs(lengths[0] - lengths[1]) <= 1

    counts = np.zeros(len(candidates), np.int64)
    for place, cast in votes.items():
        for first in cast:
            chosen = [first]
            for vote in cast:
                if all(agree(vote, other) for other in chosen):
                    chosen.append(vote)
            counts[place] = max(counts[place], len(chosen))
    return counts


def test_votes_are_those_of_the_rule() -> None:
    rng = np.random.default_rng(4)
    candidates = random_rows("votes", 6, seed=4)
    for place in range(len(candidates)):
        for query in (candidates[place], random_rows("votes", 1, seed=5 + place)[0]):
            seen = query.copy()
            seen[rng.integers(0, len(seen), 20)] *= np.float32(1.02)
            found, distances = nearest(seen[None], candidates, k=6, metric="votes")
            members = len(blocks(seen.astype(float), 66))
            expected = 1 - count_votes(seen, candidates) / members
            assert distances[0] == pytest.approx(expected[found[0]], abs=1e-6)
            assert found[0].tolist() == np.argsort(expected, kind="stable").tolist()
            pair = compare_descriptors(seen, candidates[place], "votes")[0]
            alone = count_votes(seen, candidates[place : place + 1])[0]
            assert pair == pytest.approx(1 - alone / members, abs=1e-6)


def test_a_moved_and_turned_place_gets_all_votes() -> None:
    rng = np.random.default_rng(6)
    row = rng.uniform(1, 2, (20, 66))
    row[:, 64:] = rng.uniform(-30, 30, (20, 2))
    other = row.copy()
    angle = 0.7
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    other[:, 64:] = row[:, 64:] @ rotation.T + [5, -3]
    pair = [rows.astype(np.float32).ravel() for rows in (row, other)]
    assert compare_descriptors(*pair, "votes") == (0, None)


@rows("metric", ["scan_context", "aligned_polar", "intensity_scan_context"])
def test_a_turn_by_whole_columns_is_found(metric: str) -> None:
    row = random_rows(metric, 2, seed=7)[1]
    for columns in (0, 1, 25, 59):
        seen = np.roll(row.reshape(60, -1), -columns, axis=0).ravel()
        distance, yaw = compare_descriptors(seen, row, metric)
        assert distance == pytest.approx(0, abs=1e-6)
        assert yaw is not None
        assert np.exp(1j * yaw) == pytest.approx(np.exp(2j * np.pi * columns / 60))
        if metric == "scan_context":
            assert compare_scan_contexts(seen, row) == (distance, yaw)


@rows(
    "metric, row, message",
    [
        ("chi_square", [1, -2], r"descriptor 1 .*-2.*position 1"),
        ("l1", [1e37] * 100, "descriptor 1 .*too long.*l1"),
        ("regions", [0] * 308, "descriptor 1 .*empty set.*308"),
        ("nearest_of_set", [0] * 8, "descriptor 1 .*empty set.*2"),
        ("votes", [0] * 66, "descriptor 1 .*empty set.*66"),
        ("intensity_scan_context", [-1] * 60, "descriptor 1 .*-1"),
        ("iris", [0.5] * 720, "descriptor 1 .*0.5.*65535"),
    ],
)
def test_values_without_meaning_are_refused(metric: str, row: list[float], message: str) -> None:
    bad = np.array(row, np.float32)
    good = np.ones_like(bad)
    index = index_of(good[None], metric)
    for call in (
        lambda: compare_descriptors(good, bad, metric),
        lambda: nearest_causal(np.stack([good, bad]), window=0, metric=metric),
        lambda: index.add(bad),
        lambda: index.query(bad),
    ):
        with pytest.raises(DataError, match=message):
            call()
    assert len(index) == 1


LENGTHS = {
    "regions": 308,
    "nearest_of_set": 4,
    "votes": 66,
    "scan_context": 60,
    "aligned_polar": 60,
    "aligned_cartesian": 40,
    "intensity_scan_context": 60,
    "iris": 720,
    "ring": 120,
}


@rows("metric", metric_names())
def test_other_lengths_nan_and_unknown_metrics_are_refused(metric: str) -> None:
    length = LENGTHS.get(metric, 7)
    row = np.ones(length, np.float32)
    if metric in LENGTHS:
        other = np.ones(length + 1, np.float32)
        for call in (
            lambda: DescriptorIndex(length + 1, metric=metric),
            lambda: nearest(other[None], other[None], metric=metric),
            lambda: compare_descriptors(other, other, metric),
        ):
            with pytest.raises(ShapeError, match=rf"\b{length + 1}\b.*{metric}.*\b{length}\b"):
                call()
    with pytest.raises(ShapeError, match=rf"\b{length}\b.*\b{2 * length}\b"):
        compare_descriptors(row, np.ones(2 * length, np.float32), metric)
    spoilt = row.copy()
    spoilt[length // 2] = np.nan
    with pytest.raises(DataError, match="descriptor 1 is not finite"):
        compare_descriptors(row, spoilt, metric)
    with pytest.raises(ConfigError, match=r"metric is 'hamming'.*iris"):
        compare_descriptors(row, row, "hamming")


@rows("metric", ["l2", "regions"])
@rows("window", [0, 2])
def test_descriptors_of_zeros_have_no_candidates_and_are_none(metric: str, window: int) -> None:
    table = np.random.default_rng(3).uniform(0.1, 1, (9, 308)).astype(np.float32)
    table[[2, 5]] = 0
    found = match_described(table, window, 3, metric)
    for query in range(len(table)):
        candidates = [j for j in range(query - window) if j not in (2, 5)]
        if query in (2, 5):
            candidates = []
        apart = [compare_descriptors(table[query], table[j], metric)[0] for j in candidates]
        expected = [candidates[place] for place in np.argsort(apart, kind="stable")[:3]]
        assert found.indices[query].tolist() == expected + [-1] * (3 - len(expected))
    apart = pairwise_distances(table, metric)
    assert np.isnan(apart[[2, 5]]).all() and np.isnan(apart[:, [2, 5]]).all()
    assert np.isfinite(np.delete(np.delete(apart, [2, 5], 0), [2, 5], 1)).all()
