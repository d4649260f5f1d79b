# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Pose cells refuse what cannot be and stay as they were; stored, they go on to the bit."""

import io
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusionslam import ConfigError, DataError, FusionSlamError, ShapeError
from fusionslam.ratslam import ActionKind, PoseCells

PRESETS = ("robust", "openratslam")
State = dict[str, Any]


def toured(preset: Any, events: int = 40, seed: int = 1) -> PoseCells:
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


def assert_same(found: State, expected: State) -> None:
    assert found.keys() == expected.keys()
    for name, array in expected.items():
        assert found[name].dtype == array.dtype, name
        assert found[name].tobytes() == array.tobytes(), name


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(
    ("odometry", "words"),
    [
        ((math.nan, 0.0, 0.1), "v nan"),
        ((0.1, math.nan, 0.1), "w nan"),
        ((0.1, 0.0, math.nan), "dt nan"),
        ((math.inf, 0.0, 0.0), "finite numbers"),
        ((0.0, -math.inf, 0.1), "finite numbers"),
        ((0.0, 0.0, math.inf), "dt inf"),
        ((0.1, 0.0, -0.1), "dt of 0 or more"),
        ((1e200, 0.0, 1e200), "expected no more than 1e\\+09"),
        ((1e10, 0.0, 1.0), "a way of 2.5e\\+10 cells"),
        ((0.0, 1e10, 1.0), "a turn of 1e\\+10 rad"),
        ((None, 0.0, 0.1), "v None.*expected numbers"),
        (("fast", 0.0, 0.1), "v 'fast'.*expected numbers"),
        ((10**400, 0.0, 0.1), "expected numbers"),
    ],
)
def test_odometry_that_cannot_be_changes_nothing(preset: Any, odometry: Any, words: str) -> None:
    cells = toured(preset, 3)
    before = cells.state()
    with pytest.raises(DataError, match=words):
        cells.on_odometry(*odometry)
    assert_same(cells.state(), before)


def test_the_reference_says_what_to_do_about_steps_of_a_cell() -> None:
    cells = toured("openratslam", 3)
    before = cells.state()
    with pytest.raises(DataError, match=r"1\.25 cells.*preset='robust'"):
        cells.on_odometry(-0.5, 0.0, 1.0)
    assert_same(cells.state(), before)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(
    ("view", "words"),
    [
        ((-1,), "view -1: expected 0 to 12, the next new one"),
        ((13,), "view 13: expected 0 to 12"),
        ((10**30,), "expected 0 to 12"),
        ((1.0,), "view 1.0: expected a whole number"),
        (("1",), "view '1': expected a whole number"),
        ((None,), "view None: expected a whole number"),
        ((1, math.nan), "rotation nan"),
        ((1, math.inf), "finite numbers"),
        ((1, 1e200), "no more than"),
        ((1, "left"), "rotation 'left'"),
        ((1, 0.0, (math.nan, 0.0)), "place \\(nan"),
        ((1, 0.0, (0.0, 1e300)), "no more than"),
        ((1, 0.0, (0.0,)), "a number and x, y"),
        ((1, 0.0, 3.0), "a number and x, y"),
    ],
)
def test_views_that_cannot_be_change_nothing(preset: Any, view: Any, words: str) -> None:
    cells = PoseCells(preset=preset)
    for known in range(12):
        cells.on_view(known)
        cells.on_odometry(0.1, 0.1, 0.5)
        cells.action()
    before = cells.state()
    with pytest.raises(DataError, match=words):
        cells.on_view(*view)
    assert_same(cells.state(), before)


@pytest.mark.parametrize("preset", PRESETS)
def test_nothing_is_to_do_before_both_a_view_and_odometry(preset: Any) -> None:
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


@pytest.mark.parametrize(
    "change",
    [
        {"size": 6},
        {"size": 1001},
        {"cell_m": 0},
        {"cell_m": math.inf},
        {"inject": -1},
        {"delta_pc": 0},
        {"step_s": 0},
        {"global_inhibition": 1},
        {"preset": "fast"},
        {"neurons": 3},
    ],
    ids=str,
)
def test_configurations_that_cannot_be_are_refused_by_name(change: Any) -> None:
    with pytest.raises(ConfigError, match=next(iter(change))):
        PoseCells(**change)


@pytest.mark.parametrize("preset", PRESETS)
@settings(max_examples=12, deadline=None)
@given(before=st.integers(0, 30), seed=st.integers(0, 2**32 - 1))
def test_restored_cells_go_on_to_the_bit(preset: Any, before: int, seed: int) -> None:
    cells = toured(preset, before, seed)
    file = io.BytesIO()
    np.savez(file, **cells.state())
    file.seek(0)
    restored = PoseCells(preset=preset)
    with np.load(file) as stored:
        restored.restore(dict(stored))
    assert_same(restored.state(), cells.state())
    assert restored.best == cells.best
    assert tour(restored, 15, seed + 1) == tour(cells, 15, seed + 1)
    assert_same(restored.state(), cells.state())


def test_a_loop_may_still_be_refused_after_restoring() -> None:
    cells = toured("robust", 14)
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
    assert_same(restored.state(), cells.state())


def test_the_state_is_a_copy() -> None:
    cells = toured("robust", 5)
    before = cells.state()
    kept = {name: array.copy() for name, array in before.items()}
    tour(cells, 5, 9)
    assert_same(before, kept)
    cells.restore(before)
    before["places"][:] = before["cells"][:] = 7
    assert_same(cells.state(), kept)


def refused(preset: Any, change: Any) -> str:
    """What is said of a changed state, by cells that stay as they were."""
    state, cells = toured(preset).state(), toured(preset, 5, 2)
    before = cells.state()
    change(state)
    with pytest.raises((DataError, ShapeError)) as found:
        cells.restore(state)
    assert_same(cells.state(), before)
    return str(found.value)


NAMES = sorted(PoseCells().state())


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("name", NAMES)
def test_states_with_an_array_missing_or_of_another_shape_or_kind_are_refused(
    preset: Any, name: str
) -> None:
    assert f"no array {name!r}" in refused(preset, lambda state: state.pop(name))
    for change in (
        lambda array: array[:-1],
        lambda array: array[None],
        lambda array: np.concatenate((array, array)),
        lambda array: array.astype("U5"),
        lambda array: array.astype(complex),
    ):
        said = refused(
            preset, lambda state, change=change: state.update({name: change(state[name])})
        )
        assert name in said or said.startswith(("the activity has", "network"))


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("cells", math.nan, "cells holds values that are not finite"),
        ("cells", -1.0, "0 or more"),
        ("network", math.nan, "finite"),
        ("places", math.inf, "places holds values"),
        ("experiences", math.nan, "experiences holds values"),
        ("relative", math.nan, "relative holds values"),
        ("views_of", -1, "views_of holds -1"),
        ("views_of", 10**9, "views_of holds 1000000000"),
        ("since", 10**9, "since holds"),
        ("counts", -1, "counts holds -1"),
        ("counts", 10**9, "counts holds 1000000000"),
    ],
)
def test_states_with_values_that_cannot_be_are_refused(
    preset: Any, name: str, value: Any, words: str
) -> None:
    def change(state: State) -> None:
        state[name] = state[name].copy()
        state[name][...] = value

    assert words in refused(preset, change)


@pytest.mark.parametrize(("mine", "theirs"), [PRESETS, PRESETS[::-1]])
def test_the_state_of_another_preset_is_refused(mine: Any, theirs: Any) -> None:
    cells = PoseCells(preset=mine)
    with pytest.raises(DataError, match="network"):
        cells.restore(toured(theirs).state())
    assert cells.best == (10, 10, 18)


def test_the_state_of_another_size_is_refused() -> None:
    with pytest.raises(FusionSlamError, match=r"\(36, 20, 20\), expected \(36, 21, 21\)"):
        PoseCells(size=21).restore(toured("robust").state())
