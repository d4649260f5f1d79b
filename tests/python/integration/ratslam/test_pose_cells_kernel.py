# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The kernel of the pose cells against plain NumPy, and input that is refused."""

import io
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import convolve

from drives import same, unchanged
from fusionslam import ConfigError, DataError, ShapeError
from fusionslam._core import PoseSheet
from fusionslam.ratslam import ActionKind, PoseCells
from rows import rows
from threads import run_together

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


def settle(cells: Floats, inhibition: float = INHIBITION) -> Floats:
    excited = convolve(cells, box(7, 1), mode="wrap")
    left = np.maximum(excited - convolve(excited, box(5, 2), mode="wrap") - inhibition, 0)
    result: Floats = left / left.sum()
    return result


def scatter(cells: Floats, x: Floats, y: Floats, layers: float) -> Floats:
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


@rows("size", [7, 8, 20, 21])
def test_a_step_of_the_attractor_is_that_of_two_wrapped_convolutions(size: int) -> None:
    sheet, expected = sheet_of(noise(size)), noise(size)
    for _ in range(3):
        sheet.settle(INHIBITION)
        expected = settle(expected)
        np.testing.assert_allclose(sheet.activity, expected, rtol=0, atol=1e-14)


def test_the_start_is_one_cell_in_the_middle_that_becomes_a_packet() -> None:
    sheet = PoseSheet(20)
    start = np.zeros((HEADINGS, 20, 20))
    start[18, 10, 10] = 1
    np.testing.assert_array_equal(sheet.activity, start)
    sheet.settle(INHIBITION)
    np.testing.assert_allclose(sheet.activity, settle(start), rtol=0, atol=1e-15)


@settings(max_examples=30)
@given(ways, ways, ways, st.integers(0, 2**32 - 1))
def test_activity_moves_as_if_every_cell_were_dealt_out(
    x: float, y: float, layers: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    xs, ys = x * random.uniform(-1, 1, HEADINGS), y * random.uniform(-1, 1, HEADINGS)
    cells = noise(9, seed)
    sheet = sheet_of(cells)
    sheet.move(xs, ys, layers)
    np.testing.assert_allclose(sheet.activity, scatter(cells, xs, ys, layers), rtol=0, atol=1e-9)
    assert sheet.activity.min() >= 0 and abs(sheet.activity.sum() - 1) < 1e-12


@settings(max_examples=50)
@given(*[st.integers(-(10**6), 10**6)] * 3)
def test_whole_cells_are_moved_to_the_bit(x: int, y: int, layers: int) -> None:
    cells = noise(7)
    sheet = sheet_of(cells)
    sheet.move(np.full(HEADINGS, float(x)), np.full(HEADINGS, float(y)), layers)
    np.testing.assert_array_equal(sheet.activity, np.roll(cells, (layers, y, x), (0, 1, 2)))


places = st.tuples(st.floats(0, 20), st.floats(0, 20), st.floats(0, HEADINGS))


def apart(found: Any, expected: Any, size: int) -> float:
    period = np.array((size, size, HEADINGS))
    away = (np.array(found) - np.array(expected) + period / 2) % period - period / 2
    return float(np.abs(away).max())


@settings(max_examples=50)
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


@settings(max_examples=50)
@given(*[st.floats(-1e6, 1e6)] * 3)
def test_injected_energy_has_its_mean_at_the_place(x: float, y: float, th: float) -> None:
    cells = np.zeros((HEADINGS, 20, 20))
    cells[9, 9, 9] = 1e-30
    sheet = sheet_of(cells)
    sheet.inject(x, y, th, 0.25)
    added = sheet.activity - cells
    assert np.count_nonzero(added) <= 8 and added.min() >= 0
    assert abs(added.sum() - 0.25) < 1e-12
    expected = [_straight_mean(added, axis) for axis in (2, 1, 0)]
    assert apart(expected, (x % 20, y % 20, th % HEADINGS), 20) < 1e-8


def _straight_mean(cells: Floats, axis: int) -> float:
    """The mean along an axis of two neighbours at most, which may lie across the border."""
    sums = cells.sum(axis=tuple(other for other in range(3) if other != axis))
    first = int(sums.argmax())
    around = np.roll(sums, 2 - first)[:5]
    return float(first - 2 + (around * np.arange(5)).sum() / around.sum()) % len(sums)


@rows("size", [-1, 0, 6, 1001])
def test_a_sheet_too_small_or_too_large_is_refused(size: int) -> None:
    with pytest.raises(ConfigError, match="size"):
        PoseSheet(size)


LAYERS = np.zeros(HEADINGS)


@rows(
    "work, error",
    [
        (lambda sheet: sheet.assign(noise(20)[:, :, 1:]), ShapeError),
        (lambda sheet: sheet.assign(noise(20) * math.nan), DataError),
        (lambda sheet: sheet.assign(noise(20) - 1), DataError),
        (lambda sheet: sheet.assign(noise(20) * 0), DataError),
        (lambda sheet: sheet.assign(noise(20) * 0 + 1e305), DataError),
        (lambda sheet: sheet.move(LAYERS[1:], LAYERS, 0), ShapeError),
        (lambda sheet: sheet.move(LAYERS + math.inf, LAYERS, 0), DataError),
        (lambda sheet: sheet.move(LAYERS, LAYERS, math.nan), DataError),
        (lambda sheet: sheet.inject(math.nan, 0, 0, 1.0), DataError),
        (lambda sheet: sheet.inject(0, math.inf, 0, 1.0), DataError),
        (lambda sheet: sheet.inject(0, 0, 0, -1.0), DataError),
        (lambda sheet: sheet.settle(1.0), ConfigError),
        (lambda sheet: sheet.settle(math.inf), ConfigError),
        (lambda sheet: sheet.settle(math.nan), ConfigError),
        (lambda sheet: sheet.settle(-math.inf), ConfigError),
    ],
)
def test_invalid_input_of_a_sheet_is_refused_and_changes_nothing(
    work: Callable[[PoseSheet], None], error: type[Exception]
) -> None:
    sheet = sheet_of(noise(20))
    with pytest.raises(error):
        work(sheet)
    np.testing.assert_array_equal(sheet.activity, noise(20))


def test_threads_may_share_a_sheet() -> None:
    sheet, alone = sheet_of(noise(20)), sheet_of(noise(20))

    def work() -> None:
        for _ in range(10):
            sheet.settle(INHIBITION)
            sheet.decode()

    run_together(*[work] * 4)
    for _ in range(40):
        alone.settle(INHIBITION)
    np.testing.assert_array_equal(sheet.activity, alone.activity)


PRESETS = ("robust", "openratslam")


def tour_cells(preset: Any, events: int = 40, seed: int = 1) -> PoseCells:
    """Cells after views, new ones and known ones, and loops, some of them refused."""
    cells = PoseCells(preset=preset)
    tour(cells, events, seed)
    return cells


def tour(cells: PoseCells, events: int, seed: int) -> list[Any]:
    """The same for the same seed; what came out of it."""
    random, done = np.random.default_rng(seed), []
    for _ in range(events):
        known = len(cells.state()["places"])
        view = random.integers(0, min(known, 14) + 1)
        cells.on_view(view, random.normal(), tuple(random.normal(size=2)))
        for _ in range(3):
            cells.on_odometry(random.uniform(-0.3, 0.6), random.normal(), 0.4)
            action = cells.action()
            if action.kind == ActionKind.CREATE_EDGE and random.random() < 0.5:
                action = cells.refuse(action)
            done.append((action, cells.best))
    return done


NO_NUMBERS = [math.nan, math.inf, -math.inf, None, "fast", 10**400]
WRONG_ODOMETRY = [(value, 0.0, 0.1) for value in NO_NUMBERS]
WRONG_ODOMETRY += [(0.1, value, 0.1) for value in NO_NUMBERS]
WRONG_ODOMETRY += [(0.1, 0.0, value) for value in (*NO_NUMBERS, -0.1)]
WRONG_ODOMETRY += [(1e200, 0.0, 1e200), (1e10, 0.0, 1.0), (0.0, 1e10, 1.0)]
WRONG_VIEWS: list[Any] = [(view,) for view in (-1, 13, 10**30, 1.0, "1", None)]
WRONG_VIEWS += [(1, turn) for turn in (math.nan, math.inf, 1e200, "left")]
WRONG_VIEWS += [(1, 0.0, place) for place in ((math.nan, 0.0), (0.0, 1e300), (0.0,), 3.0)]


@rows("preset", PRESETS)
def test_invalid_odometry_and_views_change_nothing(preset: Any) -> None:
    cells = PoseCells(preset=preset)
    for known in range(12):
        cells.on_view(known)
        cells.on_odometry(0.1, 0.1, 0.5)
        cells.action()
    with unchanged(cells):
        for odometry in WRONG_ODOMETRY:
            with pytest.raises(DataError, match="odometry"):
                cells.on_odometry(*odometry)
        for view in WRONG_VIEWS:
            with pytest.raises(DataError, match="relative" if len(view) > 1 else "view"):
                cells.on_view(*view)


def test_the_reference_refuses_steps_of_a_cell_and_names_the_other_preset() -> None:
    cells = tour_cells("openratslam", 3)
    with unchanged(cells), pytest.raises(DataError, match="robust"):
        cells.on_odometry(-0.5, 0.0, 1.0)


@rows("preset", PRESETS)
def test_there_is_no_action_before_both_a_view_and_odometry(preset: Any) -> None:
    for first in ("view", "odometry"):
        cells = PoseCells(preset=preset)
        assert cells.action().kind == ActionKind.NONE
        for what in (first, "odometry" if first == "view" else "view"):
            assert cells.action().kind == ActionKind.NONE
            if what == "view":
                cells.on_view(0)
            else:
                cells.on_odometry(0.1, 0.0, 0.1)
        action = cells.action()
        assert (action.kind, action.source, action.target) == (ActionKind.CREATE_NODE, 0, 0)


@settings(max_examples=4)
@given(st.sampled_from(PRESETS), st.integers(0, 12), st.integers(0, 2**32 - 1))
def test_restored_cells_go_on_to_the_bit(preset: Any, before: int, seed: int) -> None:
    cells = tour_cells(preset, before, seed)
    file = io.BytesIO()
    np.savez(file, **cells.state())
    file.seek(0)
    restored = PoseCells(preset=preset)
    with np.load(file) as stored:
        restored.restore(dict(stored))
    assert same(restored.state(), cells.state()) and restored.best == cells.best
    assert tour(restored, 8, seed + 1) == tour(cells, 8, seed + 1)
    assert same(restored.state(), cells.state())


def test_a_loop_may_still_be_refused_after_restoring() -> None:
    cells = tour_cells("robust", 14)
    for view in range(40):
        cells.on_view(view % 4)
        cells.on_odometry(0.0, 0.0, 0.5)
        action = cells.action()
        if action.kind == ActionKind.CREATE_EDGE:
            break
    assert action.kind == ActionKind.CREATE_EDGE
    restored = PoseCells()
    restored.restore(cells.state())
    assert restored.refuse(action) == cells.refuse(action)
    assert same(restored.state(), cells.state())


def test_the_state_is_a_copy() -> None:
    cells = tour_cells("robust", 5)
    before = cells.state()
    kept = {name: array.copy() for name, array in before.items()}
    tour(cells, 5, 9)
    assert same(before, kept)
    cells.restore(before)
    before["places"][:] = before["cells"][:] = 7
    assert same(cells.state(), kept)


CHANGES: list[Callable[[Any], Any]] = [
    lambda array: array[:-1],
    lambda array: array[None],
    lambda array: np.concatenate((array, array)),
    lambda array: array.astype("U5"),
    lambda array: array.astype(complex),
]
IMPOSSIBLE: list[tuple[str, float]] = [("cells", -1.0), ("places", math.inf), ("since", 10**9)]
IMPOSSIBLE += [(name, math.nan) for name in ("cells", "network", "experiences", "relative")]
IMPOSSIBLE += [(name, value) for name in ("views_of", "counts") for value in (-1, 10**9)]


@rows("preset", PRESETS)
def test_states_with_an_array_missing_or_wrong_are_refused_by_its_name(preset: Any) -> None:
    good, cells = tour_cells(preset).state(), tour_cells(preset, 5, 2)
    wrong = [(name, {key: good[key] for key in good if key != name}) for name in good]
    wrong += [(name, good | {name: change(good[name])}) for name in good for change in CHANGES]
    wrong += [(name, good | {name: np.full_like(good[name], value)}) for name, value in IMPOSSIBLE]
    for name, state in wrong:
        with unchanged(cells), pytest.raises((DataError, ShapeError), match=f"{name}|activity"):
            cells.restore(state)


@rows("mine, theirs", [PRESETS, PRESETS[::-1]])
def test_the_state_of_another_preset_is_refused(mine: Any, theirs: Any) -> None:
    cells = PoseCells(preset=mine)
    with pytest.raises(DataError, match="network"):
        cells.restore(tour_cells(theirs).state())
    assert cells.best == (10, 10, 18)


def test_the_state_of_another_size_is_refused() -> None:
    with pytest.raises(ShapeError):
        PoseCells(size=21).restore(tour_cells("robust").state())
