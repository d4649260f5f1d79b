# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Global CoSPAIR against numpy, and turns about the sensor."""

import numpy as np
from numpy.typing import NDArray

import fusionslam
from clouds import cie_lab
from fusionslam import CospairConfig
from places import make_place
from rows import rows

RANGES = ((-np.pi, np.pi), (-1, 1), (-1, 1), (0, 100), (-128, 128), (-128, 128))


def reference(points: np.ndarray, colors: np.ndarray, leaf: float) -> NDArray[np.float64]:
    cloud, shades, _ = fusionslam.voxel_downsample(points, colors, size=leaf)
    normals, _, kept = fusionslam.estimate_normals(cloud, radius=3 * leaf)
    normals, cloud, shades = normals.astype(np.float64), cloud[kept].astype(float), shades[kept]
    u = normals.mean(axis=0) / np.linalg.norm(normals.mean(axis=0))
    offsets = cloud - cloud.mean(axis=0)
    distances = np.linalg.norm(offsets, axis=1)
    v = np.cross(offsets, u)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    w = np.cross(u, v)
    theta = np.arctan2((w * normals).sum(axis=1), normals @ u)
    columns = [theta, (v * normals).sum(axis=1), offsets @ u / distances, *cie_lab(shades).T]
    shells = np.minimum((7 * distances / distances.max()).astype(int), 6)
    found = [
        np.histogram(values[shells == shell], bins=9, range=limits)[0] / (shells == shell).sum()
        for shell in range(7)
        for values, limits in zip(columns, RANGES, strict=True)
    ]
    return np.concatenate(found)


@rows("seed", range(2))
def test_it_is_the_histograms_of_angles_and_colours_by_shell(seed: int) -> None:
    place = make_place(seed)
    found = fusionslam.cospair(place.points, place.colors)
    assert found.dtype == np.float32
    assert found.shape == (378,)
    expected = reference(place.points, place.colors, CospairConfig().leaf)
    # A few points lie near the border of a bin.
    assert np.abs(found - expected).mean() < 1e-4
    np.testing.assert_allclose(found, expected, atol=5e-3)


def test_colours_change_the_halves_of_colours_only() -> None:
    place = make_place(4)
    known = fusionslam.cospair(place.points, place.colors).reshape(7, 2, 27)
    other = fusionslam.cospair(place.points, 255 - place.colors).reshape(7, 2, 27)
    np.testing.assert_array_equal(other[:, 0], known[:, 0])
    assert (other[:, 1] != known[:, 1]).any()
