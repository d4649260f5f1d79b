# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Differences of colours against published figures."""

import itertools
import math
from typing import Any

import numpy as np
import pytest

from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.views import ciede2000, color_difference
from project import SMALL_DATA
from rows import rows

# Sharma, Wu, Dalal, "The CIEDE2000 color-difference formula: implementation notes, supplementary
# test data, and mathematical observations", 2005, table 1: two colours (L, a, b), the difference.
SHARMA_PAIRS = np.loadtxt(SMALL_DATA / "ciede2000.csv", delimiter=",", skiprows=1)

# (L, a, b) of the corners of sRGB with white D65, as tables of the colour space give them.
LAB = {
    (0, 0, 0): (0, 0, 0),
    (255, 255, 255): (100, 0, 0),
    (255, 0, 0): (53.24, 80.09, 67.20),
    (0, 255, 0): (87.73, -86.18, 83.18),
    (0, 0, 255): (32.30, 79.19, -107.86),
    (255, 255, 0): (97.14, -21.55, 94.48),
}


def test_ciede2000_gives_the_34_published_differences() -> None:
    assert len(SHARMA_PAIRS) == 34
    for pair in SHARMA_PAIRS:
        first, second, published = pair[:3], pair[3:6], pair[6]
        assert ciede2000(first, second) == pytest.approx(published, abs=1e-4), pair
        assert ciede2000(second, first) == pytest.approx(published, abs=1e-4), pair


@rows("a, b", itertools.product(LAB, LAB))
def test_differences_of_bytes_are_those_of_lab_values(a: Any, b: Any) -> None:
    assert color_difference(a, b, "cie76") == pytest.approx(math.dist(LAB[a], LAB[b]), abs=0.05)
    assert color_difference(a, b) == pytest.approx(ciede2000(LAB[a], LAB[b]), abs=0.05)


def test_the_author_sees_red_alone() -> None:
    authors = color_difference([10, 0, 200], [30, 255, 0], "author")
    assert authors == pytest.approx(20 * math.sqrt(3), abs=1e-12)
    assert color_difference([10, 20, 30], [13, 24, 42], "rgb") == pytest.approx(13, abs=1e-12)


@rows("kind", ["cie76", "ciede2000", "rgb", "author"])
def test_a_colour_does_not_differ_from_itself(kind: str) -> None:
    for color in ([0, 0, 0], [127.5, 3.25, 250], [255, 255, 255]):
        assert color_difference(color, color, kind) == 0


def test_colours_between_bytes_lie_between_their_neighbours() -> None:
    low, half, high = ([value, 40, 90] for value in (100, 100.5, 101))
    whole = color_difference(low, high, "cie76")
    parts = color_difference(low, half, "cie76"), color_difference(half, high, "cie76")
    assert sum(parts) == pytest.approx(whole, rel=1e-3)
    assert parts[0] == pytest.approx(parts[1], rel=1e-2)


@rows(
    "a, kind, error, words",
    [
        ([0, 0, math.nan], "cie76", DataError, "nan"),
        ([0, 256, 0], "rgb", DataError, "255"),
        ([-1, 0, 0], "author", DataError, "255"),
        ([0, 0], "cie76", ShapeError, "\\(3,\\)"),
        (["red", "green", "blue"], "cie76", ShapeError, "dtype"),
        ([0, 0, 0], "cie94", ConfigError, "ciede2000"),
    ],
)
def test_bad_colours_are_refused(a: list[float], kind: str, error: Any, words: str) -> None:
    with pytest.raises(error, match=words):
        color_difference(a, [1, 2, 3], kind)


@rows("lab", [[50, math.inf, 0], [50, 1e300, 0]])
def test_infinite_lab_values_are_refused(lab: list[float]) -> None:
    with pytest.raises(DataError):
        ciede2000(lab, [50, 0, 0])
