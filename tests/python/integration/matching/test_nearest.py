# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The neighbours found are those of NumPy, and what an index refuses."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from arrays import SECOND, filled
from fusionslam import ConfigError, DataError, DescriptorIndex, ShapeError, nearest, nearest_causal
from rows import rows


def brute_force(
    rows: NDArray[np.float32], query: NDArray[np.float32], allowed: NDArray[np.bool_], k: int
) -> tuple[list[int], list[float]]:
    """The k nearest allowed rows, ties to the lowest number."""
    distances = np.linalg.norm(rows.astype(np.float64) - query.astype(np.float64), axis=1)
    order = [int(i) for i in np.argsort(distances, kind="stable") if allowed[i]][:k]
    return order, [float(np.float32(distances[i])) for i in order]


def index_of(table: NDArray[np.float32]) -> DescriptorIndex:
    index = DescriptorIndex(table.shape[1])
    for row in table:
        index.add(row)
    return index


@st.composite
def tables(draw: st.DrawFn) -> NDArray[np.float32]:
    """Tables with many equal distances (few whole values) or with none (normal values)."""
    rows, columns = draw(st.integers(1, 25)), draw(st.integers(1, 9))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    if draw(st.booleans()):
        return rng.integers(-1, 2, (rows, columns)).astype(np.float32)
    return rng.normal(size=(rows, columns)).astype(np.float32)


@settings(max_examples=100, deadline=None)
@given(
    table=tables(),
    window=st.integers(0, 30),
    window_seconds=st.sampled_from([0.0, 0.5, 2.0, 7.25]),
    k=st.integers(1, 30),
    data=st.data(),
)
def test_the_neighbours_are_those_of_numpy_with_a_window_in_frames_and_seconds(
    table: NDArray[np.float32], window: int, window_seconds: float, k: int, data: st.DataObject
) -> None:
    steps = data.draw(
        st.lists(
            st.sampled_from([0, 1, SECOND // 4, SECOND // 2, 3 * SECOND]),
            min_size=len(table),
            max_size=len(table),
        )
    )
    stamps = np.cumsum(steps, dtype=np.int64) + 1_700_000_000 * SECOND
    index = DescriptorIndex(table.shape[1], window=window, window_seconds=window_seconds)
    for number, row in enumerate(table):
        stamp = int(stamps[number])
        allowed = np.arange(number) < number - window
        if window_seconds:
            allowed &= stamp - stamps[:number] > round(window_seconds * SECOND)
        indices, distances = index.query(row, k=k, stamp_ns=stamp)
        expected = brute_force(table[:number], row, allowed, k)
        assert indices.tolist() == expected[0]
        assert distances == pytest.approx(expected[1], rel=1e-6)
        assert index.add(row, stamp_ns=stamp) == number
    assert len(index) == len(table)


@settings(max_examples=60, deadline=None)
@given(table=tables(), window=st.integers(0, 30), k=st.integers(1, 6))
def test_a_batch_is_what_an_online_run_finds(table: Any, window: int, k: int) -> None:
    indices, distances = nearest_causal(table, window=window, k=k)
    assert indices.shape == distances.shape == (len(table), k)
    assert indices.dtype == np.int64 and distances.dtype == np.float32
    index = DescriptorIndex(table.shape[1], window=window)
    for number, row in enumerate(table):
        online = index.query(row, k=k)
        found = len(online[0])
        assert indices[number].tolist() == [*online[0], *[-1] * (k - found)]
        assert distances[number, :found].tobytes() == online[1].tobytes()
        assert np.isinf(distances[number, found:]).all()
        index.add(row)


HARD_TABLES: dict[str, Callable[[np.random.Generator, tuple[int, int]], NDArray[Any]]] = {
    "normal": lambda rng, shape: rng.normal(size=shape),
    "near ties": lambda rng, shape: 1 + 1e-7 * rng.integers(0, 3, shape),
    "far from the origin": lambda rng, shape: 1e6 + rng.normal(size=shape),
    "denormals": lambda rng, shape: 1e-42 * rng.normal(size=shape),
    "squares beyond float32": lambda rng, shape: 1e30 * rng.normal(size=shape),
}


@rows("kind", HARD_TABLES)
@rows("columns", [1, 7, 192, 575, 576])
def test_one_query_and_a_batch_find_the_neighbours_of_numpy(kind: str, columns: int) -> None:
    table = HARD_TABLES[kind](np.random.default_rng(7), (200, columns)).astype(np.float32)
    queries = np.ascontiguousarray(table[::-9]) * np.float32(1.01)
    index = index_of(table)
    batch = nearest(queries, table, k=5)
    assert batch[0].shape == batch[1].shape == (len(queries), 5)
    assert batch[0].dtype == np.int64 and batch[1].dtype == np.float32
    for number, query in enumerate(queries):
        squares = np.sum((table.astype(np.float64) - query.astype(np.float64)) ** 2, axis=1)
        indices, distances = index.query(query, k=5)
        assert np.array_equal(indices, batch[0][number])
        assert distances.tobytes() == batch[1][number].tobytes()
        # NumPy adds in another order, so that ties may fall the other way in the last digits.
        assert np.allclose(squares[indices], np.sort(squares)[:5], rtol=1e-13, atol=0)
        assert distances == pytest.approx(np.sqrt(squares[indices]), rel=1e-6, abs=1e-45)


def test_a_batch_of_other_length_is_refused() -> None:
    with pytest.raises(ShapeError, match=r"queries .*3.*descriptors .*4"):
        nearest(np.zeros((2, 3), np.float32), np.zeros((2, 4), np.float32))


def test_descriptors_whose_distances_would_overflow_are_refused() -> None:
    index = DescriptorIndex(2)
    with pytest.raises(DataError, match="descriptor 0 "):
        index.add(np.array([3e38, -3e38], np.float32))
    with pytest.raises(DataError, match="descriptor 1 "):
        nearest_causal(np.array([[0, 0], [3e38, 0]], np.float32), window=0)
    assert len(index) == 0


def test_one_or_two_threads_give_the_same_bytes() -> None:
    table = np.random.default_rng(2).normal(size=(400, 64)).astype(np.float32)
    results = {
        tuple(part.tobytes() for part in nearest_causal(table, window=9, k=3, threads=threads))
        for threads in (1, 1, 2, 2, 0)
    }
    assert len(results) == 1


def test_an_empty_index_answers_with_nothing() -> None:
    indices, distances = DescriptorIndex(4).query(np.zeros(4, np.float32), k=3)
    assert indices.shape == distances.shape == (0,)
    assert indices.dtype == np.int64 and distances.dtype == np.float32


@rows("value", [np.nan, np.inf])
def test_a_descriptor_that_is_not_finite_is_refused_and_not_added(value: float) -> None:
    index = filled()
    spoilt = np.zeros(7, np.float32)
    spoilt[3] = value
    for call in (index.add, lambda row: index.query(row, stamp_ns=0)):
        with pytest.raises(DataError, match=r"descriptor 20 .*position 3"):
            call(spoilt)
    assert len(index) == 20
    with pytest.raises(DataError, match="descriptor 1 "):
        nearest_causal(np.stack([np.zeros(7, np.float32), spoilt]), window=0)


def test_a_descriptor_of_another_length_is_refused_and_not_added() -> None:
    index = filled()
    for call in (index.add, lambda row: index.query(row, stamp_ns=0)):
        with pytest.raises(ShapeError, match=r"\b8\b.*\b7\b"):
            call(np.zeros(8, np.float32))
    assert len(index) == 20


def test_a_window_in_seconds_needs_stamps() -> None:
    with pytest.raises(ConfigError, match="stamp_ns"):
        filled().query(np.zeros(7, np.float32))
    index = DescriptorIndex(3, window_seconds=5.0)
    with pytest.raises(ConfigError, match="stamp_ns"):
        index.add(np.ones(3, np.float32))
    assert len(index) == 0


@rows(
    "options, message",
    [
        ({"dimension": 0}, r"dimension .*\b0"),
        ({"dimension": -3}, r"dimension .*-3"),
        ({"dimension": 4, "window": -1}, r"window .*-1"),
        ({"dimension": 4, "window_seconds": -0.5}, r"window_seconds .*-0\.5"),
        ({"dimension": 4, "window_seconds": float("nan")}, r"window_seconds .*\bnan"),
    ],
)
def test_options_out_of_range_are_refused(options: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        DescriptorIndex(**options)


def test_k_must_be_positive_and_an_index_within_range() -> None:
    index = filled()
    for k in (0, -1):
        with pytest.raises(ConfigError, match=f"k .*{k}"):
            index.query(np.zeros(7, np.float32), k=k, stamp_ns=0)
        with pytest.raises(ConfigError, match=f"k .*{k}"):
            nearest_causal(np.zeros((3, 7), np.float32), window=0, k=k)
    with pytest.raises(ShapeError, match=r"descriptor 20\b"):
        index.descriptor(20)


def test_a_k_beyond_all_bounds_is_refused_and_does_not_crash() -> None:
    with pytest.raises((ConfigError, MemoryError)):
        nearest_causal(np.zeros((4, 3), np.float32), window=0, k=2**62)


def test_an_index_may_be_shared_by_threads_that_add_and_query() -> None:
    table = np.random.default_rng(5).normal(size=(3000, 64)).astype(np.float32)
    index = index_of(table[:1])

    def ask(_: int) -> None:
        while len(index) < len(table):
            found, distances = index.query(table[0])
            assert found[0] == 0 and distances[0] == 0

    with ThreadPoolExecutor(3) as pool:
        askers = pool.map(ask, range(2))
        for row in table[1:]:
            index.add(row)
        list(askers)
    assert len(index) == len(table)


def test_threads_may_save_to_one_path_at_a_time(tmp_path: Path) -> None:
    index = index_of(np.random.default_rng(6).normal(size=(500, 64)).astype(np.float32))
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: index.save(tmp_path / "places.index"), range(40)))
    assert len(DescriptorIndex.load(tmp_path / "places.index")) == 500
    assert [path.name for path in tmp_path.iterdir()] == ["places.index"]
