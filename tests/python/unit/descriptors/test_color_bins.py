# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Colours and the bins they fall into."""

import colorsys
from itertools import product

import numpy as np

import fusionslam
from clouds import distance, street
from rows import rows


def bins_of_color(color: tuple[int, int, int], color_space: str, preset: str) -> list[int]:
    """The histogram bin of each channel, read from the signature of a cloud of one colour."""
    points = np.array([[0, 0, 0], [3, 0, 0], [0, 2, 0], [1, 1, 1], [4, 1, 2]], np.float32)
    colors = np.full((len(points), 3), color, np.uint8)
    signature = fusionslam.cm2dp_signature(points, colors, color_space=color_space, preset=preset)
    channels = signature[:, 128:].reshape(64, 3, 8, 16).sum(axis=(0, 2))
    assert ((channels > 0).sum(axis=1) == 1).all()
    return [int(bin_) for bin_ in channels.argmax(axis=1)]


def linear_from_srgb(value: float, deciding: float) -> float:
    return ((value + 0.055) / 1.055) ** 2.4 if deciding > 0.04045 else value / 12.92


def cie_lab(color: tuple[int, int, int], *, author: bool) -> list[float]:
    """IEC 61966-2-1 and CIE 15: L, a, b, scaled to 0 .. 1 as c-M2DP does.

    The author decides about green and blue by the red value that is already linear.
    """
    r, g, b = (value / 255 for value in color)
    red = linear_from_srgb(r, r)
    green = linear_from_srgb(g, red if author else g)
    blue = linear_from_srgb(b, red if author else b)
    matrix = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    ratios = np.array(matrix) @ [red, green, blue] / [0.95047, 1.0, 1.08883]
    threshold = (6 / 29) ** 3
    fx, fy, fz = np.where(
        ratios > threshold, np.cbrt(ratios), ratios / (3 * (6 / 29) ** 2) + 4 / 29
    )
    return [(116 * fy - 16) / 100, (500 * (fx - fy) + 128) / 255, (200 * (fy - fz) + 128) / 255]


def expected_values(color: tuple[int, int, int], color_space: str, preset: str) -> list[float]:
    if color_space == "rgb":
        return [value / 255 for value in color]
    if color_space == "hsv":
        return list(colorsys.rgb_to_hsv(*(value / 255 for value in color)))
    return cie_lab(color, author=preset == "author")


SPECIAL_COLORS = [
    (r, g, b) for r in (0, 128, 255) for g in (0, 128, 255) for b in (0, 128, 255)
] + [(11, 10, 10), (12, 3, 9), (60, 10, 5), (1, 0, 0), (0, 0, 1), (254, 255, 255)]


@rows("preset, color_space", product(["paper", "author"], ["rgb", "hsv", "lab"]))
def test_colours_fall_into_the_bins_of_the_standard_formulas(color_space: str, preset: str) -> None:
    rng = np.random.default_rng(8)
    drawn = [(int(r), int(g), int(b)) for r, g, b in rng.integers(0, 256, (60, 3))]
    width = {"rgb": (255 / 16 + 0.001) / 255}.get(color_space, 1 / 16 + 0.001)
    for color in SPECIAL_COLORS + drawn:
        places = np.array(expected_values(color, color_space, preset)) / width
        clear = np.abs(places - np.rint(places)) > 0.01  # the matrices above have four digits
        if color_space != "lab":
            clear[:] = True
        given = np.array(bins_of_color(color, color_space, preset))
        assert np.array_equal(given[clear], np.floor(places[clear])), color


def test_half_the_exposure_leaves_the_robust_descriptor_unchanged() -> None:
    points, colors = street(8)
    bright = colors // 2 * 2
    dark = fusionslam.cm2dp(points, bright // 2)
    assert distance(dark, fusionslam.cm2dp(points, bright)) <= 1e-4
    plain = [fusionslam.cm2dp(points, c, preset="paper") for c in (bright, bright // 2)]
    assert distance(*plain) > 0.1  # what it would be otherwise
