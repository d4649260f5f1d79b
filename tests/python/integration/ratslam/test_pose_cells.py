# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pose cells under odometry and views."""

import math
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drives import unchanged
from fusionslam import DataError
from fusionslam.ratslam import Action, ActionKind, PoseCells
from rows import rows

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
    """End of arcs from the middle of the sheet, in cells, by complex numbers."""
    place, heading = complex(10, 10), math.pi
    for v, w, dt in legs:
        turn, way = w * dt, v * dt / CELL_M
        # The chord of an arc is its mean direction; that of a straight leg is 1.
        chord = (np.exp(1j * turn) - 1) / (1j * turn) if abs(turn) > 1e-6 else np.exp(0.5j * turn)
        place += way * chord * np.exp(1j * heading)
        heading += turn
    return np.array((place.real, place.imag, heading * 18 / math.pi)) % PERIOD


@settings(max_examples=15)
@given(st.sampled_from(PRESETS), drives)
def test_activity_is_not_negative_and_sums_to_one(preset: Any, events: Any) -> None:
    cells = PoseCells(preset=preset)
    drive(cells, events)
    cells.on_odometry(0.2, 0.1, 0.1)
    assert cells.activity.min() >= 0 and abs(cells.activity.sum() - 1) < 1e-9
    assert all(0 <= one < period for one, period in zip(cells.best, PERIOD, strict=True))


def shift_start(preset: Any, x: int, y: int, quarters: int) -> PoseCells:
    """Cells whose start is moved by whole cells after it is turned by quarters of a turn."""
    cells = PoseCells(preset=preset)
    state = cells.state()
    activity = np.zeros((36, 20, 20))
    activity[(18 + QUARTER * quarters) % 36, (10 + y) % 20, (10 + x) % 20] = 1
    start = (10 + x) % 20, (10 + y) % 20, (18 + QUARTER * quarters) % 36
    cells.restore({**state, "cells": activity, "network": np.r_[start, state["network"][3:]]})
    return cells


@settings(max_examples=12)
@given(
    st.sampled_from(PRESETS),
    st.lists(strides, min_size=1, max_size=25),
    st.integers(-30, 30),
    st.integers(-30, 30),
    st.integers(0, 3),
)
def test_shifting_and_turning_the_start_shifts_and_turns_the_result(
    preset: Any, events: Any, x: int, y: int, quarters: int
) -> None:
    cells, moved = PoseCells(preset=preset), shift_start(preset, x, y, quarters)
    for one in (cells, moved):
        drive(one, events)
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


def test_a_full_turn_of_whole_layers_returns_in_the_reference() -> None:
    cells = PoseCells(preset="openratslam")
    for _ in range(36):
        cells.on_odometry(0.0, math.pi / 18, 1.0)
    assert apart(cells.best, (10, 10, 18)) < 1e-9


@rows("degrees", [0, 45, 90, 123.4, 180, 270])
def test_the_packet_wraps_at_every_border(degrees: float) -> None:
    cells, legs = PoseCells(), [(0.0, math.radians(degrees), 1.0)]
    legs += [(0.31, 0.0, 1.0)] * 60
    for leg in legs:
        cells.on_odometry(*leg)
    assert apart(cells.best, dead_reckoning(legs)) < 1e-6
    # The packet itself moved, too.
    top = np.unravel_index(int(cells.activity.argmax()), (36, 20, 20))[::-1]
    assert apart(top, cells.best) < 1.5


def ways(fastest: float) -> st.SearchStrategy[list[tuple[float, float, float]]]:
    leg = st.tuples(st.floats(-fastest, fastest), st.floats(-7, 7), st.floats(0, 5))
    return st.lists(leg, min_size=1, max_size=8)


@settings(max_examples=15)
@given(st.one_of(ways(3), ways(1e4)))
def test_the_pose_is_where_odometry_leads_however_long_a_step(
    way: list[tuple[float, float, float]],
) -> None:
    cells = PoseCells()
    for leg in way:
        cells.on_odometry(*leg)
    assert apart(cells.best, dead_reckoning(way)) < 1e-6
    assert abs(cells.activity.sum() - 1) < 1e-9


@settings(max_examples=8)
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


@rows("dt", [1e3, 1e6, 1e12, 1e15])
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


def test_nothing_moves_if_no_time_passes() -> None:
    cells = PoseCells()
    cells.on_odometry(0.3, 0.2, 0.7)
    with unchanged(cells):
        cells.on_odometry(50.0, 20.0, 0.0)


def test_thousands_of_templates_in_one_place() -> None:
    cells = PoseCells()
    for view in range(3_000):
        cells.on_view(view)
        cells.on_odometry(0.0, 0.0, 0.001)
        assert cells.action()[:3] == (ActionKind.CREATE_NODE, max(view - 1, 0), view)
    # They are all alike: one of them is found again where it was.
    stand(cells, 1234)
    assert cells.action()[:3] == (ActionKind.CREATE_EDGE, 2999, 1234)
    assert apart(cells.best, (10, 10, 18)) < 1e-6
    assert abs(cells.activity.sum() - 1) < 1e-9


LAYER = math.radians(10)


def learn_views(views: int = 12, **changes: Any) -> PoseCells:
    """A cell between any two of the views, along -x from the middle; every one has a node."""
    cells = PoseCells(**changes)
    for view in range(views):
        cells.on_view(view)
        cells.on_odometry(0.9999 * CELL_M, 0.0, 1.0)
        cells.action()
    return cells


def stand(cells: PoseCells, view: int, *seen: Any, times: int = 1) -> None:
    """Look at a view, standing still for half a second."""
    for _ in range(times):
        cells.on_view(view, *seen)
        cells.on_odometry(0.0, 0.0, 0.5)


def look_at(cells: PoseCells, view: int, times: int, *seen: Any) -> PoseCells:
    """Look at a view again and again, and three times as often at the newest one instead."""
    newest = len(cells.state()["places"]) - 1
    for _ in range(times):
        stand(cells, view, *seen)
        stand(cells, newest, times=3)
    return cells


def test_an_old_view_that_is_seen_again_brings_the_pose_back() -> None:
    cells = look_at(learn_views(), 0, 8)
    assert apart(cells.best, (10, 10, 18)) < 0.01


@rows("views, seen", [(12, 2), (9, 0)])
def test_the_last_ten_views_do_not_move_the_pose(views: int, seen: int) -> None:
    cells = learn_views(views)
    before = cells.best
    assert look_at(cells, seen, 8).best == before


def test_one_wrong_view_does_not_move_the_pose() -> None:
    cells = learn_views()
    before = cells.best
    stand(cells, 0)
    assert apart(cells.best, before) < 0.01


def test_a_view_seen_all_the_time_decays_and_one_that_rested_does_not() -> None:
    cells = learn_views()
    stand(cells, 0, times=20)
    before = cells.activity
    cells.on_view(0)
    np.testing.assert_array_equal(cells.activity, before)
    for _ in range(40):
        cells.on_view(11)
    cells.on_view(0)
    assert np.abs(cells.activity - before).max() > 1e-3


@rows("turned, place", product([0.0, 0.4, -2.5, 7.0], [(0.0, 0.0), (0.5, -0.3), (-1.1, 0.7)]))
def test_the_pose_goes_where_the_robot_is_in_the_frame_of_the_view(
    turned: float, place: tuple[float, float]
) -> None:
    cells = look_at(learn_views(), 0, 8, turned, place)
    # The view was seen from the middle, heading against x.
    expected = (10 - place[0] / CELL_M, 10 - place[1] / CELL_M, 18 + turned / LAYER)
    assert apart(cells.best, expected) < 0.15


def test_a_view_between_two_steps_counts_where_the_robot_is_then() -> None:
    cells = learn_views()
    cells.on_odometry(0.7 * CELL_M, 0.9, 0.3)
    before = cells.best
    # The view agrees with the pose: nothing is to be corrected.
    ahead = ((10 - before.x) * CELL_M, (10 - before.y) * CELL_M)
    cells.on_view(0, (before.th - 18) * LAYER, ahead)
    assert apart(cells.best, before) < 1e-9
    cells.on_view(1, (before.th - 18) * LAYER, ahead)
    assert 0.05 < apart(cells.best, before) < 0.2


def test_energy_goes_between_cells_where_the_place_is_between_cells() -> None:
    cells = PoseCells(size=40)
    for view in range(14):
        cells.on_odometry(0.65 * CELL_M, 0.05, 1.0)
        cells.on_view(view)
    before, place = cells.state(), cells.state()["places"][2]
    cells.on_view(2)
    energy = 0.15 * (30 - math.exp(1.2)) / 30
    added = cells.state()["cells"] * (1 + energy) - before["cells"]
    assert np.count_nonzero(added > 1e-9) == 8 and added.sum() == pytest.approx(energy)
    # The packet and the added energy are off their places by the same.
    means = [(added.sum(axis=sums) * np.arange(size)).sum() / energy for sums, size in AXES]
    assert means == pytest.approx(place - before["network"][3:6])


AXES = (((0, 1), 40), ((0, 2), 40), ((1, 2), 36))


def test_the_reference_injects_into_one_cell_and_turns_by_the_rotation() -> None:
    cells = PoseCells(preset="openratslam")
    cells.on_view(0)
    cells.on_odometry(0.0, 0.0, 0.1)
    before = cells.activity
    cells.on_view(0, 3 * LAYER)
    added = cells.activity - before
    assert np.count_nonzero(added) == 1
    assert np.unravel_index(int(added.argmax()), added.shape) == (18 + 3, 10, 10)
    assert added.max() == pytest.approx(0.05 * (30 - math.exp(1.2 * 2)) / 30)


def edge(cells: PoseCells, view: int, *seen: Any) -> Action:
    """Look until the cells are back at a node of the view."""
    for _ in range(20):
        stand(cells, view, *seen)
        if (action := cells.action()).kind == ActionKind.CREATE_EDGE:
            return action
    raise AssertionError("never came back")


def test_an_edge_has_the_robots_pose_in_the_frame_of_the_node_not_of_the_view() -> None:
    cells = PoseCells()
    for view in range(12):
        # The first node is made where the robot is turned and aside of where its view has it.
        cells.on_view(view, 0.2, (0.1, -0.3))
        cells.on_odometry(0.9999 * CELL_M, 0.0, 1.0)
        cells.action()
    action = edge(look_at(cells, 0, 8, 0.2, (0.1, -0.3)), 0, 0.2, (0.1, -0.3))
    assert apart(cells.best, (10, 10, 18)) < 0.15
    assert (action.source, action.target) == (11, 0)
    assert action.relative_rotation == pytest.approx(0, abs=1e-9)
    assert action.relative_place == pytest.approx((0, 0), abs=1e-9)


def test_an_edge_has_the_place_in_front_of_the_node() -> None:
    cells = learn_views(12)
    look_at(cells, 0, 8, 0.0, (0.25, 0.1))
    action = edge(cells, 0, 0.3, (0.25, 0.1))
    assert action.target == 0 and action.relative_place == pytest.approx((0.25, 0.1))
    assert action.relative_rotation == pytest.approx(0.3)


def false_loop() -> tuple[PoseCells, Action, Any]:
    """Cells whose packet a wrong view has carried off, and where it was before."""
    cells = learn_views()
    before = cells.best
    return cells, edge(look_at(cells, 0, 6), 0), before


def test_a_refused_loop_makes_a_new_node_where_odometry_leads() -> None:
    cells, loop, before = false_loop()
    assert apart(cells.best, before) > 5
    instead = cells.refuse(loop)
    assert instead[:3] == (ActionKind.CREATE_NODE, loop.source, 12)
    assert apart(cells.best, before) < 0.01
    cells.on_odometry(CELL_M, 0.0, 1.0)
    assert cells.action().kind == ActionKind.NONE
    assert apart(cells.best, (before[0] - 1, *before[1:])) < 0.01


def test_the_view_of_a_refused_loop_rests() -> None:
    cells, loop, before = false_loop()
    cells.refuse(loop)
    activity = cells.activity
    cells.on_view(0)
    np.testing.assert_array_equal(cells.activity, activity)
    stand(cells, 0, times=20)
    assert apart(cells.best, before) < 0.01


def test_a_refused_loop_goes_back_no_farther_than_to_the_last_one_that_was_kept() -> None:
    cells = learn_views(25, size=40)
    for view, place in ((0, 20), (12, 8)):
        loop = edge(look_at(cells, view, 8), view)
        assert abs(cells.best.x - place) < 0.5
        if view == 0:
            cells.on_odometry(0.0, 0.0, 0.5)
    cells.refuse(loop)
    assert abs(cells.best.x - 20) < 0.5


def test_a_loop_that_is_not_refused_is_kept() -> None:
    cells, loop, _ = false_loop()
    cells.on_odometry(0.0, 0.0, 0.5)
    with pytest.raises(DataError):
        cells.refuse(loop)
    assert apart(cells.best, (10, 10, 18)) < 0.15


@rows("kind", [ActionKind.NONE, ActionKind.CREATE_NODE])
def test_only_an_edge_can_be_refused(kind: ActionKind) -> None:
    cells = learn_views(1)
    with unchanged(cells), pytest.raises(DataError, match=kind.name):
        cells.refuse(Action(kind, 0, 0))


def test_a_false_loop_on_every_frame_that_is_refused_leaves_dead_reckoning() -> None:
    cells, refused = learn_views(30), 0
    start = cells.best
    for step in range(60):
        cells.on_view(step % 15)
        cells.on_odometry(0.25 * CELL_M, 0.0, 1.0)
        action = cells.action()
        if action.kind == ActionKind.CREATE_EDGE:
            cells.refuse(action)
            refused += 1
    assert refused > 5
    assert apart(cells.best, (start.x - 15, start.y, start.th)) < 3
