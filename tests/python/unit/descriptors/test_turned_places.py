# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Turns of a place about z, for descriptors that do not change with them or change little."""

from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from fusionslam import Cloud
from places import make_place, turn


def describe(name: str, place: Cloud, degrees: float = 0.0) -> NDArray[np.float32]:
    points = turn(place.points, degrees)
    of_colors = name in ("cospair", "gasd_color")
    describe = getattr(fusionslam, name)
    return describe(points, place.colors) if of_colors else describe(points)


@pytest.mark.parametrize("name", ["vfh", "cvfh", "our_cvfh", "cospair"])
def test_quarter_turns_keep_the_cubes_and_the_descriptor(name: str) -> None:
    place = make_place(1)
    known = describe(name, place)
    for degrees in (90, 270):
        # Rounding moves a few of 7,000 points to the next bin.
        atol = 5e-3 if name == "cospair" else 0.1
        np.testing.assert_allclose(describe(name, place, degrees), known, atol=atol)


@pytest.mark.parametrize(
    ("name", "order", "degrees"),
    [
        ("esf", 1, (10, 45, 90, 200)),
        ("gfh", 2, (3, 50, 123)),
        ("vfh", 1, (17, 45, 160)),
        ("cospair", 2, (17, 160)),
    ],
)
def test_other_turns_change_it_less_than_another_place_does(
    name: str, order: int, degrees: tuple[float, ...]
) -> None:
    place = make_place(2)
    known = describe(name, place)
    length = partial(np.linalg.norm, ord=order)
    elsewhere = length(describe(name, make_place(3)) - known)
    for each in degrees:
        turned = length(describe(name, place, each) - known)
        assert turned < 0.5 * elsewhere
        assert name != "esf" or turned < 0.15


def test_turns_and_shifts_move_few_points_to_other_cells_of_gasd() -> None:
    place = make_place(1)
    known = describe("gasd_color", place).astype(np.float64)
    shifted = Cloud(place.points + np.float32([4, -3, 0.5]), place.colors)
    for degrees in (30.0, 90.0, 180.0, 275.0):
        # Half of the points would make 200: 100 percent each of cells and of hues.
        assert np.abs(describe("gasd_color", shifted, degrees) - known).sum() < 1
