# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Views and the pose cells: what they inject, where, and what becomes of the map's refusal."""

import math
from typing import Any

import numpy as np
import pytest

from fusionslam import DataError
from fusionslam.ratslam import Action, ActionKind, PoseCells

PERIOD = np.array((20.0, 20.0, 36.0))
CELL_M = 0.4
LAYER = math.radians(10)


def apart(found: Any, expected: Any) -> float:
    """The largest difference on the sheet, in cells."""
    away = (np.array(found) - np.array(expected) + PERIOD / 2) % PERIOD - PERIOD / 2
    return float(np.abs(away).max())


def learned(views: int = 12, **changes: Any) -> PoseCells:
    """A cell between any two of the views, along -x from the middle; every one has a node."""
    cells = PoseCells(**changes)
    for view in range(views):
        cells.on_view(view)
        cells.on_odometry(0.9999 * CELL_M, 0.0, 1.0)
        cells.action()
    return cells


def looked(cells: PoseCells, view: int, times: int, *seen: Any, rest: int = 3) -> PoseCells:
    """Look at a view again and again, standing still, at times at the newest one instead."""
    newest = len(cells.state()["places"]) - 1
    for _ in range(times):
        cells.on_view(view, *seen)
        cells.on_odometry(0.0, 0.0, 0.5)
        for _ in range(rest):
            cells.on_view(newest)
            cells.on_odometry(0.0, 0.0, 0.5)
    return cells


def test_an_old_view_that_is_seen_again_brings_the_pose_back() -> None:
    cells = looked(learned(), 0, 8)
    assert apart(cells.best, (10, 10, 18)) < 0.01


def test_views_of_the_last_ten_bring_nothing() -> None:
    cells = learned()
    before = cells.best
    assert looked(cells, 2, 8).best == before
    few = learned(9)
    before = few.best
    assert looked(few, 0, 8).best == before


def test_one_wrong_view_does_not_move_the_pose() -> None:
    cells = learned()
    before = cells.best
    cells.on_view(0)
    cells.on_odometry(0.0, 0.0, 0.5)
    assert apart(cells.best, before) < 0.01


def test_a_view_that_one_stares_at_wears_off_and_one_that_rested_does_not() -> None:
    cells = learned()
    for _ in range(20):
        cells.on_view(0)
        cells.on_odometry(0.0, 0.0, 0.5)
    before = cells.activity
    cells.on_view(0)
    np.testing.assert_array_equal(cells.activity, before)
    for _ in range(40):
        cells.on_view(11)
    cells.on_view(0)
    assert np.abs(cells.activity - before).max() > 1e-3


@pytest.mark.parametrize("turned", [0.0, 0.4, -2.5, 7.0])
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.5, -0.3), (-1.1, 0.7)])
def test_the_pose_goes_where_the_robot_is_in_the_frame_of_the_view(
    turned: float, place: tuple[float, float]
) -> None:
    cells = looked(learned(), 0, 8, turned, place)
    # The view was seen from the middle, heading against x.
    expected = (10 - place[0] / CELL_M, 10 - place[1] / CELL_M, 18 + turned / LAYER)
    assert apart(cells.best, expected) < 0.15


def test_a_view_between_two_steps_tells_of_the_robot_there() -> None:
    cells = learned()
    cells.on_odometry(0.7 * CELL_M, 0.9, 0.3)
    before = cells.best
    # What is told is what is so: nothing is to be corrected.
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
    assert np.count_nonzero(added > 1e-9) == 8
    assert added.sum() == pytest.approx(energy)
    # The packet and what is told of it lie off their place by the same.
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
        cells.on_view(view, *seen)
        cells.on_odometry(0.0, 0.0, 0.5)
        action = cells.action()
        if action.kind == ActionKind.CREATE_EDGE:
            return action
    raise AssertionError("never came back")


def test_an_edge_tells_the_robot_in_the_frame_of_the_node_not_of_the_view() -> None:
    cells = PoseCells()
    for view in range(12):
        # The first node is made where the robot is turned and aside of where its view has it.
        cells.on_view(view, 0.2, (0.1, -0.3))
        cells.on_odometry(0.9999 * CELL_M, 0.0, 1.0)
        cells.action()
    action = edge(looked(cells, 0, 8, 0.2, (0.1, -0.3)), 0, 0.2, (0.1, -0.3))
    assert apart(cells.best, (10, 10, 18)) < 0.15
    assert (action.source, action.target) == (11, 0)
    assert action.relative_rotation == pytest.approx(0, abs=1e-9)
    assert action.relative_place == pytest.approx((0, 0), abs=1e-9)


def test_a_place_in_front_of_the_node_is_told_as_such() -> None:
    cells = learned(12)
    looked(cells, 0, 8, 0.0, (0.25, 0.1))
    action = edge(cells, 0, 0.3, (0.25, 0.1))
    assert action.target == 0
    assert action.relative_place == pytest.approx((0.25, 0.1))
    assert action.relative_rotation == pytest.approx(0.3)


def false_loop() -> tuple[PoseCells, Action, tuple[float, float, float]]:
    """Cells whose packet a wrong view has carried off, and where it was before."""
    cells = learned()
    before = tuple(cells.best)
    return cells, edge(looked(cells, 0, 6), 0), (before[0], before[1], before[2])


def test_a_refused_loop_makes_a_new_node_where_the_robot_was() -> None:
    cells, loop, _ = false_loop()
    instead = cells.refuse(loop)
    assert (instead.kind, instead.source, instead.target) == (
        ActionKind.CREATE_NODE,
        loop.source,
        12,
    )
    cells.on_odometry(0.0, 0.0, 0.5)
    assert cells.action().kind == ActionKind.NONE


def test_after_a_refused_loop_the_pose_is_where_odometry_leads() -> None:
    cells, loop, before = false_loop()
    assert apart(cells.best, before) > 5
    cells.refuse(loop)
    assert apart(cells.best, before) < 0.01
    cells.on_odometry(CELL_M, 0.0, 1.0)
    assert apart(cells.best, (before[0] - 1, *before[1:])) < 0.01


def test_the_view_of_a_refused_loop_rests() -> None:
    cells, loop, before = false_loop()
    cells.refuse(loop)
    activity = cells.activity
    cells.on_view(0)
    np.testing.assert_array_equal(cells.activity, activity)
    for _ in range(20):
        cells.on_view(0)
        cells.on_odometry(0.0, 0.0, 0.5)
    assert apart(cells.best, before) < 0.01


def test_a_refused_loop_goes_back_no_farther_than_to_the_last_one_that_was_kept() -> None:
    cells = learned(25, size=40)
    for view, place in ((0, 20), (12, 8)):
        loop = edge(looked(cells, view, 8), view)
        assert abs(cells.best.x - place) < 0.5
        if view == 0:
            cells.on_odometry(0.0, 0.0, 0.5)
    cells.refuse(loop)
    assert abs(cells.best.x - 20) < 0.5


def test_a_loop_that_is_not_refused_is_kept() -> None:
    cells, loop, _ = false_loop()
    cells.on_odometry(0.0, 0.0, 0.5)
    with pytest.raises(DataError, match="not the last edge"):
        cells.refuse(loop)
    assert apart(cells.best, (10, 10, 18)) < 0.15


@pytest.mark.parametrize("kind", [ActionKind.NONE, ActionKind.CREATE_NODE])
def test_only_an_edge_can_be_refused(kind: ActionKind) -> None:
    cells = learned(1)
    before = cells.state()
    with pytest.raises(DataError, match=f"{kind.name} to 0 is not the last edge"):
        cells.refuse(Action(kind, 0, 0))
    np.testing.assert_array_equal(cells.state()["experiences"], before["experiences"])


def test_a_false_loop_on_every_frame_that_is_refused_leaves_dead_reckoning() -> None:
    cells, refused = learned(30), 0
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
