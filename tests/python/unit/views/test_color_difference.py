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
from rows import rows

# Sharma, Wu, Dalal, "The CIEDE2000 color-difference formula: implementation notes, supplementary
# test data, and mathematical observations", 2005, table 1: two colours (L, a, b), the difference.
SHARMA_PAIRS = np.array(
    [
        [50.0000, 2.6772, -79.7751, 50.0000, 0.0000, -82.7485, 2.0425],
        [50.0000, 3.1571, -77.2803, 50.0000, 0.0000, -82.7485, 2.8615],
        [50.0000, 2.8361, -74.0200, 50.0000, 0.0000, -82.7485, 3.4412],
        [50.0000, -1.3802, -84.2814, 50.0000, 0.0000, -82.7485, 1.0000],
        [50.0000, -1.1848, -84.8006, 50.0000, 0.0000, -82.7485, 1.0000],
        [50.0000, -0.9009, -85.5211, 50.0000, 0.0000, -82.7485, 1.0000],
        [50.0000, 0.0000, 0.0000, 50.0000, -1.0000, 2.0000, 2.3669],
        [50.0000, -1.0000, 2.0000, 50.0000, 0.0000, 0.0000, 2.3669],
        [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0009, 7.1792],
        [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0010, 7.1792],
        [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0011, 7.2195],
        [50.0000, 2.4900, -0.0010, 50.0000, -2.4900, 0.0012, 7.2195],
        [50.0000, -0.0010, 2.4900, 50.0000, 0.0009, -2.4900, 4.8045],
        [50.0000, -0.0010, 2.4900, 50.0000, 0.0010, -2.4900, 4.8045],
        [50.0000, -0.0010, 2.4900, 50.0000, 0.0011, -2.4900, 4.7461],
        [50.0000, 2.5000, 0.0000, 50.0000, 0.0000, -2.5000, 4.3065],
        [50.0000, 2.5000, 0.0000, 73.0000, 25.0000, -18.0000, 27.1492],
        [50.0000, 2.5000, 0.0000, 61.0000, -5.0000, 29.0000, 22.8977],
        [50.0000, 2.5000, 0.0000, 56.0000, -27.0000, -3.0000, 31.9030],
        [50.0000, 2.5000, 0.0000, 58.0000, 24.0000, 15.0000, 19.4535],
        [50.0000, 2.5000, 0.0000, 50.0000, 3.1736, 0.5854, 1.0000],
        [50.0000, 2.5000, 0.0000, 50.0000, 3.2972, 0.0000, 1.0000],
        [50.0000, 2.5000, 0.0000, 50.0000, 1.8634, 0.5757, 1.0000],
        [50.0000, 2.5000, 0.0000, 50.0000, 3.2592, 0.3350, 1.0000],
        [60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644],
        [63.0109, -31.0961, -5.8663, 62.8187, -29.7946, -4.0864, 1.2630],
        [61.2901, 3.7196, -5.3901, 61.4292, 2.2480, -4.9620, 1.8731],
        [35.0831, -44.1164, 3.7933, 35.0232, -40.0716, 1.5901, 1.8645],
        [22.7233, 20.0904, -46.6940, 23.0331, 14.9730, -42.5619, 2.0373],
        [36.4612, 47.8580, 18.3852, 36.2715, 50.5065, 21.2231, 1.4146],
        [90.8027, -2.0831, 1.4410, 91.1528, -1.6435, 0.0447, 1.4441],
        [90.9257, -0.5406, -0.9208, 88.6381, -0.8985, -0.7239, 1.5381],
        [6.7747, -0.2908, -2.4247, 5.8714, -0.0985, -2.2286, 0.6377],
        [2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082],
    ]
)

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
