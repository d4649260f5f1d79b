# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""SOLiD against numpy, written from the paper (Kim et al., RA-L 2024), and turns of a cloud."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from clouds import polar_cloud, seen_after_turn, street
from fusionslam._core import SolidConfig, compare_solid_azimuths, solid, solid_parts
from rows import rows

RANGES, AZIMUTHS = 40, 60
Floats = NDArray[np.float32]


def reference_parts(
    points: Floats, elevations: int = 32, lowest: float = -25, highest: float = 15
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    voxels, number = np.unique(np.floor(points / 0.5), axis=0, return_inverse=True)
    means = np.stack(
        [np.bincount(number.ravel(), points[:, i], len(voxels)) for i in range(3)], axis=1
    )
    x, y, z = (means / np.bincount(number.ravel())[:, None]).astype(np.float32).T.astype(np.float64)
    reach = np.hypot(x, y)
    elevation = np.degrees(np.arctan2(z, reach))
    edges = np.linspace(lowest, highest, elevations + 1)
    inside = (reach < 80) & (elevation >= lowest) & (elevation < highest)
    azimuth = np.arctan2(y, x) % (2 * np.pi)
    by_range, by_azimuth = (
        np.histogram2d(values[inside], elevation[inside], [bins, edges])[0]
        for values, bins in (
            (reach, np.linspace(0, 80, RANGES + 1)),
            (azimuth, np.linspace(0, 2 * np.pi, AZIMUTHS + 1)),
        )
    )
    counts = by_range.sum(axis=0)
    weights = (counts - counts.min()) / (counts.max() - counts.min())
    return by_range @ weights, by_azimuth @ weights


def lone_points(rng: np.random.Generator) -> Floats:
    """Points farther apart than voxels are wide, however the cloud is turned."""
    points = polar_cloud(rng, AZIMUTHS, RANGES, 80, count=400)
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    return points[(np.tril(distances < 1, -1).sum(axis=1) == 0)]


def test_solid_by_hand() -> None:
    """Weights 1 of the two level points' bin, 0.5 of the one 11.3 degrees up."""
    points = np.array([[3, 0.1, 0.01], [-0.1, 5, 0.01], [10, 0.1, 2]], np.float32)
    ranges, azimuths = solid_parts(points)
    assert {int(i): float(ranges[i]) for i in ranges.nonzero()[0]} == {1: 1, 2: 1, 5: 0.5}
    assert {int(i): float(azimuths[i]) for i in azimuths.nonzero()[0]} == {0: 1.5, 15: 1}
    np.testing.assert_allclose(solid(points), ranges / 1.5)


def test_voxels_count_once() -> None:
    points = np.array(
        [[3.1, 0.1, 0.1], [3.2, 0.2, 0.1], [3.3, 0.1, 0.2], [9, 0.1, 0.1]], np.float32
    )
    ranges, _ = solid_parts(points)
    assert ranges[1] == ranges[4] == 1


@rows("seed", range(3))
def test_the_parts_are_weighted_sums(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for points in (polar_cloud(rng, 60, 40, 90), street(seed)[0] - np.float32([0, 0, 1.7])):
        for found, expected in zip(solid_parts(points), reference_parts(points), strict=True):
            assert found.dtype == np.float32
            np.testing.assert_allclose(found, expected, rtol=1e-6)
    config = SolidConfig(elevations=16, lowest_elevation=-10.0, highest_elevation=30.0)
    found, _ = solid_parts(points, config=config)
    np.testing.assert_allclose(found, reference_parts(points, 16, -10, 30)[0], rtol=1e-6)


@rows("seed", range(3))
def test_the_descriptor_has_length_one(seed: int) -> None:
    points, _ = street(seed)
    found = solid(points)
    ranges, _ = solid_parts(points)
    assert found.shape == (RANGES,)
    np.testing.assert_allclose(found, ranges / np.linalg.norm(ranges), rtol=1e-6)


@rows("turn", [0, 1, 17, 30, 31, 59])
def test_a_turn_by_bins_leaves_the_ranges_and_is_found(turn: int) -> None:
    points = lone_points(np.random.default_rng(turn))
    yaw = 2 * math.pi * turn / AZIMUTHS
    older, newer = (solid_parts(each) for each in (points, seen_after_turn(points, yaw)))
    np.testing.assert_array_equal(newer[0], older[0])
    np.testing.assert_array_equal(newer[1], np.roll(older[1], -turn))
    distance, found = compare_solid_azimuths(newer[1], older[1])
    assert distance == 0
    assert -math.pi < found <= math.pi
    assert np.angle(np.exp(1j * (found - yaw))) == pytest.approx(0, abs=1e-9)


def test_equal_elevations_weigh_one() -> None:
    ranges, _ = solid_parts(np.array([[3, 0, 0]], np.float32), config=SolidConfig(elevations=1))
    assert ranges[1] == 1
