# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""GASD with colour against numpy; PCL's values are in tests/cpp."""

import colorsys

import numpy as np
from numpy.typing import NDArray

import fusionslam
from rows import rows


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


@rows("seed", range(3))
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


def test_greys_have_the_hue_of_red() -> None:
    rng = np.random.default_rng(0)
    points = (rng.normal(size=(200, 3)) * [9, 4, 1]).astype(np.float32)
    found = fusionslam.gasd_color(points, np.full((200, 3), 77, np.uint8))[216:].reshape(-1, 12)
    assert found[:, 0].any()
    assert not found[:, 1:].any()
