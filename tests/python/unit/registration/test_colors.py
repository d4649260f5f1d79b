# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Colours agree at right poses, whatever the exposure, and are as good as random at wrong ones."""

import pickle

import numpy as np
import pytest
from numpy.typing import NDArray

from clouds import painted_blocks, scan_blocks
from fusionslam import Cloud
from fusionslam.base.arrays import Image
from fusionslam.registration import (
    PreparedCloud,
    Registration,
    register,
)
from fusionslam.registration.colors import compare_colors
from rows import rows
from streets import at

RNG = np.random.default_rng(3)
MANY: Image = RNG.integers(30, 200, (2000, 3), dtype=np.uint8)


def expose(colors: Image, gains: NDArray[np.float64]) -> Image:
    """Multiply the light of each channel; sRGB taken for a power of 2.2."""
    light = (colors / 255) ** 2.2 * gains
    return np.rint(255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)


@rows(
    "one, other, expected",
    [
        # CIELab (D65) of the named colours maroon and darkred, and of two greys, from tables.
        ((128, 0, 0), (139, 0, 0), np.linalg.norm([2.55, 2.97, 3.23])),
        ((119, 119, 119), (128, 128, 128), 53.585 - 50.034),
        ((0, 128, 128), (0, 128, 0), 20.0),  # 63 apart: the most that counts
    ],
)
def test_differences_are_those_of_cielab(
    one: tuple[int, ...], other: tuple[int, ...], expected: float
) -> None:
    colors = np.array([one, other] * 10, np.uint8)
    swapped = colors[np.arange(20) ^ 1]  # the same colours in all: there is no gain to be fitted
    assert compare_colors(colors, swapped).mean == pytest.approx(expected, abs=0.05)


def test_exposure_and_white_balance_do_not_count() -> None:
    found = compare_colors(MANY, expose(MANY, np.array([0.6, 0.75, 0.9])))
    assert found.mean < 1.5 and found.ratio < 0.1 and found.pairs == 2000


def test_a_few_pairs_of_other_things_count_little() -> None:
    other = MANY.copy()
    other[::10] = RNG.permutation(MANY)[::10]
    assert compare_colors(MANY, other).ratio < 0.2


def test_colors_that_do_not_belong_together_are_as_far_apart_as_by_chance() -> None:
    found = compare_colors(MANY, RNG.permutation(MANY))
    assert found.ratio == pytest.approx(1, abs=0.05) and found.mean > 15


def test_surfaces_of_one_color_are_no_evidence_against_a_pose() -> None:
    white = np.full((100, 3), 200, np.uint8)
    white[::2] += 1
    assert compare_colors(white, white[::-1]).ratio < 0.5


def test_swapping_the_clouds_changes_nothing() -> None:
    other = expose(RNG.permutation(MANY), np.array([1.2, 1, 0.7]))
    assert compare_colors(MANY, other).mean == pytest.approx(compare_colors(other, MANY).mean)


def test_black_points_have_a_finite_difference() -> None:
    assert np.isfinite(compare_colors(np.zeros_like(MANY), MANY).mean)


def test_few_pairs_tell_nothing() -> None:
    assert compare_colors(MANY[:19], MANY[:19]) is None
    assert compare_colors(MANY[:20], MANY[:20]) is not None


HERE, THERE = at(3, -2, 0), at(5, -1, 0)


def register_painted(palette: int) -> Registration:
    target = PreparedCloud(painted_blocks(HERE, 2))
    source = PreparedCloud(painted_blocks(THERE, 1, palette))
    return register(pickle.loads(pickle.dumps(source)), target, np.linalg.inv(HERE) @ THERE)


def test_a_registration_tells_places_of_one_shape_apart_by_their_colors() -> None:
    same, other = register_painted(0), register_painted(1)
    assert same.overlap == other.overlap and same.color_difference.ratio < 0.4
    assert other.color_difference.ratio > 0.9


def test_there_is_no_difference_without_colors_in_both_clouds() -> None:
    points, painted = scan_blocks(HERE, 1), painted_blocks(HERE, 1)
    for clouds in ((points, painted), (painted, points), (points, points)):
        found = register(*clouds, np.eye(4))
        assert found.estimate is not None and found.color_difference is None


def test_poses_that_put_no_point_on_another_have_no_difference() -> None:
    cloud = Cloud(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))
    assert register(cloud, cloud, np.eye(4)).color_difference is None
