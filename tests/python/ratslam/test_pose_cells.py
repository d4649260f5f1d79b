# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pose cells: what stays true whatever happens, and how odometry moves the pose."""

import math
import time
from typing import Any, NoReturn

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fusionslam.ratslam import ActionKind, PoseCells

Floats = NDArray[np.float64]
PRESETS = ("robust", "openratslam")

PERIOD = np.array((20.0, 20.0, 36.0))
CELL_M = 0.4
QUARTER = 9  # layers

strides = st.tuples(st.floats(-0.35, 0.35), st.floats(-2, 2), st.sampled_from((0.1, 0.3, 1.0)))
"""Odometry of less than a cell, as the openratslam preset needs it."""
looks = st.tuples(st.integers(0, 14), st.floats(-4, 4))
drives = st.lists(st.one_of(strides, looks), min_size=1, max_size=25)


def drive(cells: PoseCells, events: list[tuple[Any, ...]]) -> None:
    """Views and odometry one after the other; ids beyond the next new one are the next one."""
    known = 0
    for event in events:
        if len(event) == 2:
            view = min(event[0], known)
            known = max(known, view + 1)
            cells.on_view(view, event[1])
        else:
            cells.on_odometry(*event)
            cells.action()


def apart(found: Any, expected: Any) -> float:
    """The largest difference on the sheet, in cells."""
    away = (np.array(found) - np.array(expected) + PERIOD / 2) % PERIOD - PERIOD / 2
    return float(np.abs(away).max())


def dead_reckoning(legs: list[tuple[float, float, float]]) -> Floats:
    """Where arcs lead to from the middle of the sheet, in cells, by complex numbers."""
    place, heading = complex(10, 10), math.pi
    for v, w, dt in legs:
        turn, way = w * dt, v * dt / CELL_M
        # The chord of an arc is its mean direction; that of a straight leg is 1.
        chord = (np.exp(1j * turn) - 1) / (1j * turn) if abs(turn) > 1e-6 else np.exp(0.5j * turn)
        place += way * chord * np.exp(1j * heading)
        heading += turn
    return np.array((place.real, place.imag, heading * 18 / math.pi)) % PERIOD


@pytest.mark.parametrize("preset", PRESETS)
@settings(max_examples=40, deadline=None)
@given(events=drives)
def test_activity_is_not_negative_and_sums_to_one(preset: Any, events: Any) -> None:
    cells = PoseCells(preset=preset)
    drive(cells, events)
    cells.on_odometry(0.2, 0.1, 0.1)
    assert cells.activity.min() >= 0
    assert abs(cells.activity.sum() - 1) < 1e-9
    assert all(0 <= one < period for one, period in zip(cells.best, PERIOD, strict=True))


def shifted(preset: Any, x: int, y: int, quarters: int) -> PoseCells:
    """Cells whose start is moved by whole cells after it is turned by quarters of a turn."""
    cells = PoseCells(preset=preset)
    state = cells.state()
    activity = np.zeros((36, 20, 20))
    activity[(18 + QUARTER * quarters) % 36, (10 + y) % 20, (10 + x) % 20] = 1
    start = (10 + x) % 20, (10 + y) % 20, (18 + QUARTER * quarters) % 36
    cells.restore({**state, "cells": activity, "network": np.r_[start, state["network"][3:]]})
    return cells


@pytest.mark.parametrize("preset", PRESETS)
@settings(max_examples=40, deadline=None)
@given(events=drives, x=st.integers(-30, 30), y=st.integers(-30, 30), quarters=st.integers(0, 3))
def test_shifting_and_turning_the_start_shifts_and_turns_the_result(
    preset: Any, events: Any, x: int, y: int, quarters: int
) -> None:
    cells, moved = PoseCells(preset=preset), shifted(preset, x, y, quarters)
    for one in (cells, moved):
        drive(one, [event for event in events if len(event) == 3])
    layer, row, column = np.indices((36, 20, 20))
    away = (column - 10) + 1j * (row - 10)
    # Headings of the robust preset run from x to y, those of the reference from y to x.
    away = away * (1j if preset == "robust" else -1j) ** quarters
    target = (
        (layer + QUARTER * quarters) % 36,
        np.rint(away.imag).astype(int) % 20 + 10 + y,
        np.rint(away.real).astype(int) % 20 + 10 + x,
    )
    turned = moved.activity[target[0], target[1] % 20, target[2] % 20]
    np.testing.assert_allclose(turned, cells.activity, rtol=0, atol=1e-12)


@pytest.mark.parametrize("steps", [4, 9, 36, 72, 360])
def test_a_full_turn_returns(steps: int) -> None:
    cells = PoseCells()
    for _ in range(steps):
        cells.on_odometry(0.0, 2 * math.pi / steps, 1.0)
    assert apart(cells.best, (10, 10, 18)) < 1e-9


def test_a_full_turn_of_whole_layers_returns_in_the_reference_too() -> None:
    cells = PoseCells(preset="openratslam")
    for _ in range(36):
        cells.on_odometry(0.0, math.pi / 18, 1.0)
    assert apart(cells.best, (10, 10, 18)) < 1e-9


@pytest.mark.parametrize("w", [0.3, -1.0, 7.0])
def test_a_circle_leads_back(w: float) -> None:
    cells = PoseCells()
    for _ in range(100):
        cells.on_odometry(0.7, w, 2 * math.pi / abs(w) / 100)
    assert apart(cells.best, (10, 10, 18)) < 1e-9


@pytest.mark.parametrize("degrees", [0, 10, 45, 90, 123.4, 180, 225, 270, 315])
def test_the_packet_wraps_at_every_border(degrees: float) -> None:
    cells, legs = PoseCells(), [(0.0, math.radians(degrees), 1.0)]
    legs += [(0.31, 0.0, 1.0)] * 60
    for leg in legs:
        cells.on_odometry(*leg)
    assert apart(cells.best, dead_reckoning(legs)) < 1e-6
    # The packet itself has come along, it is no mere number.
    top = np.unravel_index(int(cells.activity.argmax()), (36, 20, 20))[::-1]
    assert apart(top, cells.best) < 1.5


def ways(fastest: float) -> st.SearchStrategy[list[tuple[float, float, float]]]:
    leg = st.tuples(st.floats(-fastest, fastest), st.floats(-7, 7), st.floats(0, 5))
    return st.lists(leg, min_size=1, max_size=8)


@settings(max_examples=60, deadline=None)
@given(st.one_of(ways(3), ways(1e4)))
def test_the_pose_is_where_odometry_leads_however_long_a_step(
    way: list[tuple[float, float, float]],
) -> None:
    cells = PoseCells()
    for leg in way:
        cells.on_odometry(*leg)
    assert apart(cells.best, dead_reckoning(way)) < 1e-6
    assert abs(cells.activity.sum() - 1) < 1e-9


@settings(max_examples=30, deadline=None)
@given(ways(7), st.integers(1, 7), st.randoms(use_true_random=False))
def test_the_rate_of_odometry_changes_nothing(way: Any, pieces: int, random: Any) -> None:
    whole, cut = PoseCells(), PoseCells()
    for number, (v, w, dt) in enumerate(way):
        for cells in (whole, cut):
            cells.on_view(number)
        whole.on_odometry(v, w, dt)
        shares = [random.random() + 0.01 for _ in range(pieces)]
        for share in shares:
            cut.on_odometry(v, w, dt * share / sum(shares))
        assert whole.action().kind == cut.action().kind
    assert apart(whole.best, cut.best) < 1e-6
    np.testing.assert_allclose(whole.activity, cut.activity, rtol=0, atol=1e-6)


def test_a_jump_longer_than_the_torus_wraps_like_its_rest() -> None:
    far, near = PoseCells(), PoseCells()
    far.on_odometry(-(1000 * 20 + 3) * CELL_M, 0.0, 1.0)
    near.on_odometry(-3 * CELL_M, 0.0, 1.0)
    assert apart(far.best, near.best) < 1e-8
    assert apart(near.best, (13, 10, 18)) < 1e-9


@pytest.mark.parametrize("dt", [1e3, 1e6, 1e12, 1e15])
def test_a_long_silence_takes_no_longer_than_a_short_one(dt: float) -> None:
    cells = PoseCells()
    cells.on_odometry(4 * CELL_M / dt, 0.0, dt)
    assert apart(cells.best, (6, 10, 18)) < 1e-6


def test_the_reference_takes_a_step_of_the_attractor_with_each_odometry() -> None:
    cells = PoseCells(preset="openratslam")
    cells.on_odometry(0.0, 0.0, 0.0)
    once = cells.activity
    assert np.count_nonzero(once) > 1
    cells.on_odometry(0.0, 0.0, 0.0)
    assert not np.array_equal(once, cells.activity)


def test_nothing_moves_where_no_time_passes() -> None:
    cells = PoseCells()
    cells.on_odometry(0.3, 0.2, 0.7)
    before = cells.state()
    cells.on_odometry(50.0, 20.0, 0.0)
    for name, array in cells.state().items():
        np.testing.assert_array_equal(array, before[name])


def test_no_step_looks_at_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[tuple[Any, ...]] = [(0.3, 0.2, 0.3), (0, 0.1), (0.1, -0.3, 0.3), (0, 0.0)] * 20
    first, second = PoseCells(), PoseCells()
    drive(first, events)

    def asked(*_: object) -> NoReturn:
        raise AssertionError("somebody asked what time it is")

    for clock in ("time", "time_ns", "monotonic", "perf_counter", "sleep"):
        monkeypatch.setattr(time, clock, asked)
    drive(second, events)
    monkeypatch.undo()
    assert first.activity.tobytes() == second.activity.tobytes()
    assert first.best == second.best


def test_ten_thousand_templates_in_one_place() -> None:
    cells = PoseCells()
    for view in range(10_000):
        cells.on_view(view)
        cells.on_odometry(0.0, 0.0, 0.001)
        action = cells.action()
        assert (action.kind, action.target) == (ActionKind.CREATE_NODE, view)
    # They are all alike: one of them is found again where it was.
    cells.on_view(4321)
    cells.on_odometry(0.0, 0.0, 0.5)
    action = cells.action()
    assert (action.kind, action.source, action.target) == (ActionKind.CREATE_EDGE, 9999, 4321)
    assert apart(cells.best, (10, 10, 18)) < 1e-6
    assert abs(cells.activity.sum() - 1) < 1e-9
