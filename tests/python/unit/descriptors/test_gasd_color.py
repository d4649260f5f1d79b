# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""GASD with colour against numpy; PCL's values are in tests/cpp."""

import colorsys

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from places import make_place, turn


def reference(points: np.ndarray, colors: np.ndarray) -> NDArray[np.float64]:
    offsets = points.astype(np.float64) - points.mean(axis=0, dtype=np.float64)
    axes = np.linalg.eigh(np.cov(offsets.T))[1]
    x, z = axes[:, 2], axes[:, 0] * -np.sign(axes[2, 0])
    x = x * np.sign(((offsets @ x) ** 3).sum())
    aligned = offsets @ np.column_stack([x, np.cross(z, x), z])
    half = np.abs(aligned).max()
    hues = np.array([colorsys.rgb_to_hsv(*color)[0] for color in colors / 255])
    # The upper faces of the cube belong to no cell.
    inside = (aligned < half).all(axis=1)
    box = [(-half, half)] * 3
    shape = np.histogramdd(aligned[inside], bins=6, range=box)[0]
    joined = np.column_stack([aligned, hues])[inside]
    color = np.histogramdd(joined, bins=[4, 4, 4, 12], range=[*box, (0, 1)])[0]
    return 100 * np.concatenate([shape.ravel(), color.ravel()]) / (len(points) - 1)


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_histogram_of_cells_and_hues(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = (rng.gamma(1, size=(500, 3)) * [9, 4, 1.5]).astype(np.float32)
    # Hues in the middle of their bins.
    hues = (rng.integers(0, 12, 500) + 0.5) / 12
    colors = np.array([colorsys.hsv_to_rgb(hue, 0.8, 0.9) for hue in hues])
    rounded = np.round(255 * colors).astype(np.uint8)
    found = fusionslam.gasd_color(points, rounded)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, reference(points, rounded), atol=1e-4)


@pytest.mark.parametrize("degrees", [30.0, 90.0, 180.0, 275.0])
def test_turns_and_shifts_move_few_points_to_other_cells(degrees: float) -> None:
    place = make_place(1)
    known = fusionslam.gasd_color(place.points, place.colors)
    moved = turn(place.points, degrees) + np.array([4, -3, 0.5], np.float32)
    found = fusionslam.gasd_color(moved, place.colors)
    # Half of the points would make 200: 100 percent each of cells and of hues.
    assert np.abs(found.astype(np.float64) - known).sum() < 1


def test_greys_have_the_hue_of_red() -> None:
    rng = np.random.default_rng(0)
    points = (rng.normal(size=(200, 3)) * [9, 4, 1]).astype(np.float32)
    found = fusionslam.gasd_color(points, np.full((200, 3), 77, np.uint8))[216:].reshape(-1, 12)
    assert found[:, 0].any()
    assert not found[:, 1:].any()


def test_one_colour_a_point_and_a_spread_in_two_directions_are_needed() -> None:
    line = np.outer(np.arange(50), [1, 2, 3]).astype(np.float32)
    with pytest.raises(fusionslam.ShapeError, match="colors has 49 rows"):
        fusionslam.gasd_color(line, np.zeros((49, 3), np.uint8))
    with pytest.raises(fusionslam.DataError, match="one line"):
        fusionslam.gasd_color(line, np.zeros((50, 3), np.uint8))
