# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The sheet of pose cells against SciPy's wrapped convolution and sums written out in NumPy."""

import math
import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import convolve

import fusionslam
from fusionslam._core import PoseSheet

Floats = NDArray[np.float64]

INHIBITION = 2e-5
HEADINGS = 36
ways = st.floats(-1e6, 1e6)


def sheet_of(activity: Floats) -> PoseSheet:
    sheet = PoseSheet(activity.shape[1])
    sheet.assign(activity)
    return sheet


def noise(size: int, seed: int = 0) -> Floats:
    cells: Floats = np.random.default_rng(seed).random((HEADINGS, size, size)) ** 8
    return cells / cells.sum()


def packet(size: int, x: float, y: float, th: float) -> Floats:
    """A round packet anywhere on the sheet."""
    squares = []
    for count, centre in ((HEADINGS, th), (size, y), (size, x)):
        away = (np.arange(count) - centre + count / 2) % count - count / 2
        squares.append(away**2)
    total = squares[0][:, None, None] + squares[1][:, None] + squares[2]
    cells: Floats = np.exp(-total / 2)
    return cells / cells.sum()


def box(width: int, deviation: float) -> Floats:
    grid = np.arange(width) - width // 2
    squares = grid[:, None, None] ** 2 + grid[:, None] ** 2 + grid**2
    weights: Floats = np.exp(-squares / (2 * deviation**2))
    return weights / weights.sum()


def settled(cells: Floats, inhibition: float = INHIBITION) -> Floats:
    excited = convolve(cells, box(7, 1), mode="wrap")
    left = np.maximum(excited - convolve(excited, box(5, 2), mode="wrap") - inhibition, 0)
    result: Floats = left / left.sum()
    return result


def scattered(cells: Floats, x: Floats, y: Floats, layers: float) -> Floats:
    """Every active cell is dealt out to the cells that its target lies between."""
    size = cells.shape[1]
    moved = np.zeros_like(cells)
    th, row, column = np.indices(cells.shape)
    targets = (th + layers, row + y[:, None, None], column + x[:, None, None])
    whole = [np.floor(target) for target in targets]
    part = [target - floor for target, floor in zip(targets, whole, strict=True)]
    for corner in np.ndindex(2, 2, 2):
        share = cells.copy()
        for axis, further in enumerate(corner):
            share *= part[axis] if further else 1 - part[axis]
        index = [
            (floor + further).astype(np.int64) % period
            for floor, further, period in zip(whole, corner, (HEADINGS, size, size), strict=True)
        ]
        np.add.at(moved, tuple(index), share)
    return moved


@pytest.mark.parametrize("size", [7, 8, 20, 21])
def test_a_step_of_the_attractor_is_that_of_two_wrapped_convolutions(size: int) -> None:
    sheet, expected = sheet_of(noise(size)), noise(size)
    for _ in range(3):
        sheet.settle(INHIBITION)
        expected = settled(expected)
        np.testing.assert_allclose(sheet.activity, expected, rtol=0, atol=1e-14)


def test_the_start_is_one_cell_in_the_middle_that_becomes_a_packet() -> None:
    sheet = PoseSheet(20)
    start = np.zeros((HEADINGS, 20, 20))
    start[18, 10, 10] = 1
    np.testing.assert_array_equal(sheet.activity, start)
    sheet.settle(INHIBITION)
    np.testing.assert_allclose(sheet.activity, settled(start), rtol=0, atol=1e-15)


@settings(max_examples=30, deadline=None)
@given(ways, ways, ways, st.integers(0, 2**32 - 1))
def test_activity_moves_as_if_every_cell_were_dealt_out(
    x: float, y: float, layers: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    xs, ys = x * random.uniform(-1, 1, HEADINGS), y * random.uniform(-1, 1, HEADINGS)
    cells = noise(9, seed)
    sheet = sheet_of(cells)
    sheet.move(xs, ys, layers)
    np.testing.assert_allclose(sheet.activity, scattered(cells, xs, ys, layers), rtol=0, atol=1e-9)
    assert sheet.activity.min() >= 0
    assert abs(sheet.activity.sum() - 1) < 1e-12


@settings(max_examples=50, deadline=None)
@given(*[st.integers(-(10**6), 10**6)] * 3)
def test_whole_cells_are_moved_to_the_bit(x: int, y: int, layers: int) -> None:
    cells = noise(7)
    sheet = sheet_of(cells)
    sheet.move(np.full(HEADINGS, float(x)), np.full(HEADINGS, float(y)), layers)
    np.testing.assert_array_equal(sheet.activity, np.roll(cells, (layers, y, x), (0, 1, 2)))


@pytest.mark.parametrize("where", [(0, 0, 0), (6, 0, 35), (0, 6, 35), (6, 6, 0), (3, 5, 17)])
def test_a_step_is_the_same_wherever_the_packet_is(where: tuple[int, int, int]) -> None:
    cells = packet(7, 3, 3, 18)
    shift = np.array((18, 3, 3)) - where[::-1]
    moved = sheet_of(np.roll(cells, -shift, (0, 1, 2)))
    sheet = sheet_of(cells)
    for one in (sheet, moved):
        one.settle(INHIBITION)
        one.move(np.full(HEADINGS, 0.3), np.full(HEADINGS, -0.6), 0.2)
    expected = np.roll(sheet.activity, -shift, (0, 1, 2))
    np.testing.assert_allclose(moved.activity, expected, rtol=0, atol=1e-15)


places = st.tuples(st.floats(0, 20), st.floats(0, 20), st.floats(0, HEADINGS))


def apart(found: Any, expected: Any, size: int) -> float:
    period = np.array((size, size, HEADINGS))
    away = (np.array(found) - np.array(expected) + period / 2) % period - period / 2
    return float(np.abs(away).max())


@settings(max_examples=100, deadline=None)
@given(places)
def test_a_packet_is_found_wherever_it_is(place: tuple[float, float, float]) -> None:
    found = sheet_of(packet(20, *place)).decode()
    # Cut off unevenly at three cells, and a circular mean draws it a little to its own middle.
    assert apart(found, place, 20) < 0.03
    assert all(0 <= one < period for one, period in zip(found, (20, 20, HEADINGS), strict=True))


def test_of_equally_large_cells_the_first_one_is_decoded() -> None:
    cells = np.zeros((HEADINGS, 20, 20))
    cells[30, 4, 5] = cells[3, 14, 15] = 0.5
    assert apart(sheet_of(cells).decode(), (15, 14, 3), 20) < 1e-12


@settings(max_examples=100, deadline=None)
@given(*[st.floats(-1e6, 1e6)] * 3)
def test_what_is_injected_has_its_mean_at_the_place(x: float, y: float, th: float) -> None:
    cells = np.zeros((HEADINGS, 20, 20))
    cells[9, 9, 9] = 1e-30
    sheet = sheet_of(cells)
    sheet.inject(x, y, th, 0.25)
    added = sheet.activity - cells
    assert np.count_nonzero(added) <= 8
    assert added.min() >= 0
    assert abs(added.sum() - 0.25) < 1e-12
    expected = [_straight_mean(added, axis) for axis in (2, 1, 0)]
    assert apart(expected, (x % 20, y % 20, th % HEADINGS), 20) < 1e-8


def _straight_mean(cells: Floats, axis: int) -> float:
    """The mean along an axis of two neighbours at most, which may lie across the border."""
    sums = cells.sum(axis=tuple(other for other in range(3) if other != axis))
    first = int(sums.argmax())
    around = np.roll(sums, 2 - first)[:5]
    return float(first - 2 + (around * np.arange(5)).sum() / around.sum()) % len(sums)


@pytest.mark.parametrize("size", [-1, 0, 6, 1001])
def test_a_sheet_too_small_or_too_large_is_refused(size: int) -> None:
    with pytest.raises(fusionslam.ConfigError, match=f"size is {size}, expected 7 to 1000"):
        PoseSheet(size)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (lambda cells: cells[:, :, 1:], fusionslam.ShapeError, "13680 cells, expected 14400"),
        (lambda cells: cells * math.nan, fusionslam.DataError, "activity is nan"),
        (lambda cells: cells - 1, fusionslam.DataError, "0 or more"),
        (lambda cells: cells * 0, fusionslam.DataError, "finite number over 0"),
        (lambda cells: cells * 0 + 1e305, fusionslam.DataError, "of all cells is inf"),
    ],
)
def test_activity_that_cannot_be_is_refused_and_changes_nothing(
    change: Any, error: type[Exception], words: str
) -> None:
    sheet = sheet_of(noise(20))
    with pytest.raises(error, match=words):
        sheet.assign(change(noise(20)))
    np.testing.assert_array_equal(sheet.activity, noise(20))


def test_ways_and_energy_that_are_not_finite_change_nothing() -> None:
    sheet, still = sheet_of(noise(20)), np.zeros(HEADINGS)
    with pytest.raises(fusionslam.ShapeError, match="35 and 36 layers, expected 36"):
        sheet.move(still[1:], still, 0)
    for x, layers in ((np.full(HEADINGS, math.inf), 0.0), (still, math.nan)):
        with pytest.raises(fusionslam.DataError, match="not finite"):
            sheet.move(x, still, layers)
    for place, energy in (((math.nan, 0, 0), 1.0), ((0, math.inf, 0), 1.0), ((0, 0, 0), -1.0)):
        with pytest.raises(fusionslam.DataError, match="energy of 0 or more"):
            sheet.inject(*place, energy)
    np.testing.assert_array_equal(sheet.activity, noise(20))


@pytest.mark.parametrize("inhibition", [1.0, math.inf, math.nan, -math.inf])
def test_inhibition_that_leaves_nothing_is_refused_and_changes_nothing(inhibition: float) -> None:
    sheet = sheet_of(noise(20))
    with pytest.raises(fusionslam.ConfigError, match="leaves no cell active"):
        sheet.settle(inhibition)
    np.testing.assert_array_equal(sheet.activity, noise(20))


def test_threads_may_share_a_sheet() -> None:
    sheet = sheet_of(noise(20))

    def work() -> None:
        for _ in range(20):
            sheet.settle(INHIBITION)
            sheet.decode()

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    alone = sheet_of(noise(20))
    for _ in range(80):
        alone.settle(INHIBITION)
    np.testing.assert_array_equal(sheet.activity, alone.activity)
