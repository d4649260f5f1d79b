# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Global CoSPAIR against numpy, and turns about the sensor."""

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from fusionslam import CospairConfig
from places import make_place, turn

RANGES = ((-np.pi, np.pi), (-1, 1), (-1, 1), (0, 100), (-128, 128), (-128, 128))


def lab_from_rgb(colors: np.ndarray) -> NDArray[np.float64]:
    """CIE 1976 with white D65."""
    encoded = colors / 255
    linear = np.where(encoded > 0.04045, ((encoded + 0.055) / 1.055) ** 2.4, encoded / 12.92)
    matrix = np.array(
        [
            [0.4124564, 0.3575761, 0.1804375],
            [0.2126729, 0.7151522, 0.0721750],
            [0.0193339, 0.1191920, 0.9503041],
        ]
    )
    relative = linear @ matrix.T / [0.95047, 1, 1.08883]
    f = np.where(relative > (6 / 29) ** 3, np.cbrt(relative), relative * (29 / 6) ** 2 / 3 + 4 / 29)
    x, y, z = f.T
    return np.column_stack([116 * y - 16, 500 * (x - y), 200 * (y - z)])


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
    columns = [theta, (v * normals).sum(axis=1), offsets @ u / distances, *lab_from_rgb(shades).T]
    shells = np.minimum((7 * distances / distances.max()).astype(int), 6)
    found = [
        np.histogram(values[shells == shell], bins=9, range=limits)[0] / (shells == shell).sum()
        for shell in range(7)
        for values, limits in zip(columns, RANGES, strict=True)
    ]
    return np.concatenate(found)


@pytest.mark.parametrize("seed", range(2))
def test_it_is_the_histograms_of_angles_and_colours_by_shell(seed: int) -> None:
    place = make_place(seed)
    found = fusionslam.cospair(place.points, place.colors)
    assert found.dtype == np.float32
    assert found.shape == (378,)
    expected = reference(place.points, place.colors, CospairConfig().leaf)
    # A few points lie near the border of a bin.
    assert np.abs(found - expected).mean() < 1e-4
    np.testing.assert_allclose(found, expected, atol=5e-3)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_quarter_turns_keep_the_cubes_and_the_descriptor(quarters: int) -> None:
    place = make_place(2)
    known = fusionslam.cospair(place.points, place.colors)
    turned = fusionslam.cospair(turn(place.points, 90 * quarters), place.colors)
    np.testing.assert_allclose(turned, known, atol=5e-3)


@pytest.mark.parametrize("degrees", [17.0, 160.0])
def test_other_turns_change_it_less_than_another_place_does(degrees: float) -> None:
    place, other = make_place(2), make_place(3)
    known = fusionslam.cospair(place.points, place.colors)
    turned = fusionslam.cospair(turn(place.points, degrees), place.colors)
    elsewhere = fusionslam.cospair(other.points, other.colors)
    assert np.linalg.norm(turned - known) < 0.5 * np.linalg.norm(elsewhere - known)


def test_colours_change_the_halves_of_colours_only() -> None:
    place = make_place(4)
    known = fusionslam.cospair(place.points, place.colors).reshape(7, 2, 27)
    other = fusionslam.cospair(place.points, 255 - place.colors).reshape(7, 2, 27)
    np.testing.assert_array_equal(other[:, 0], known[:, 0])
    assert (other[:, 1] != known[:, 1]).any()


def test_one_colour_a_point_and_normals_are_needed() -> None:
    place = make_place(0)
    with pytest.raises(fusionslam.ShapeError, match="colors has"):
        fusionslam.cospair(place.points, place.colors[1:])
    with pytest.raises(fusionslam.DataError, match="3 points with a normal"):
        fusionslam.cospair(place.points[::3000], place.colors[::3000])
