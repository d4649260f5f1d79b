# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Kin of Scan Context against numpy, and what turns and moves do to them.

The contexts of Scan Context++, and Intensity Scan Context (Wang, Wang, Xie, ICRA 2020).
"""

import math

import numpy as np
from numpy.typing import NDArray

import fusionslam
from clouds import polar_cloud, seen_after_turn
from fusionslam._core import (
    ScanContextCartesianConfig,
    ScanContextConfig,
    ScanContextPolarConfig,
    intensity_scan_context,
    scan_context_cartesian,
    scan_context_polar,
)
from rows import rows

Floats = NDArray[np.float32]
COLUMNS, ROWS = 40, 40


def cartesian_cloud(rng: np.random.Generator, lateral_cells: int = 20) -> Floats:
    """Points away from the borders of cells of 5 x 2 m."""
    along = (rng.integers(-20, 20, 1500) + rng.uniform(0.1, 0.9, 1500)) * 5
    across = (rng.integers(-lateral_cells, lateral_cells, 1500) + rng.uniform(0.1, 0.9, 1500)) * 2
    return np.stack([along, across, rng.uniform(-1.5, 8, 1500)], axis=1).astype(np.float32)


def test_the_polar_context_is_scan_context() -> None:
    points = polar_cloud(np.random.default_rng(0), 60, 20, 80)
    np.testing.assert_array_equal(scan_context_polar(points), fusionslam.scan_context(points))
    np.testing.assert_array_equal(
        scan_context_polar(points, config=ScanContextPolarConfig(max_range=40.0, height=1.5)),
        fusionslam.scan_context(points, config=ScanContextConfig(max_range=40.0, height=1.5)),
    )


def test_a_cartesian_context_by_hand() -> None:
    points = [
        [0.1, 0.1, 1],  # in the middle: row 20 of column 20
        [2, 1, -1],  # the same cell, lower
        [-99, -39, 0],  # behind, right
        [99, 39, 3],  # ahead, left
        [52, -11, -1.5],  # row 30 of column 14
        [101, 0, 9],  # too far ahead
        [0, 41, 9],  # too far to the side
        [7, 0.5, -2.5],  # below the ground
    ]
    found = scan_context_cartesian(np.array(points, np.float32))
    assert found.dtype == np.float32
    assert found.shape == (COLUMNS * ROWS,)
    assert {int(i): float(found[i]) for i in found.nonzero()[0]} == {
        20 * ROWS + 20: 3,
        0: 2,
        COLUMNS * ROWS - 1: 5,
        14 * ROWS + 30: 0.5,
    }


@rows("seed", range(2))
def test_cells_hold_the_highest_point(seed: int) -> None:
    points = cartesian_cloud(np.random.default_rng(seed))
    expected = np.zeros((COLUMNS, ROWS))
    for x, y, z in points.astype(np.float64):
        cell = int(y // 2) + 20, int(x // 5) + 20
        expected[cell] = max(expected[cell], z + 2)
    np.testing.assert_allclose(scan_context_cartesian(points), expected.ravel(), rtol=1e-6)
    half = ScanContextCartesianConfig(lateral_range=20.0, longitudinal_range=50.0)
    np.testing.assert_array_equal(
        scan_context_cartesian(points * [0.5, 0.5, 1], config=half), scan_context_cartesian(points)
    )


@rows("lanes", [1, -3])
def test_a_move_to_the_side_moves_the_columns(lanes: int) -> None:
    points = cartesian_cloud(np.random.default_rng(4), lateral_cells=16)
    older = scan_context_cartesian(points).reshape(COLUMNS, ROWS)
    moved = points - np.array([0, 2 * lanes, 0], np.float32)
    newer = scan_context_cartesian(moved).reshape(COLUMNS, ROWS)
    np.testing.assert_array_equal(newer, np.roll(older, -lanes, axis=0))


def test_half_a_turn_reverses_a_cartesian_context() -> None:
    points = cartesian_cloud(np.random.default_rng(5))
    turned = scan_context_cartesian(seen_after_turn(points, math.pi))
    np.testing.assert_array_equal(turned, scan_context_cartesian(points)[::-1])


def random_scan(seed: int) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    points = polar_cloud(rng, 60, 20, 60)
    return points, rng.uniform(0, 200, len(points)).astype(np.float32)


def test_an_intensity_context_by_hand() -> None:
    points = [[10, 0.1, 1], [10, 0.2, -9], [0.1, 30, 2], [-10, -0.1, 3], [70, 1, 0]]
    intensities = [3, 8, 0, 4, 99]
    found = intensity_scan_context(
        np.array(points, np.float32), np.array(intensities, np.float32)
    ).reshape(60, 20)
    assert {(int(s), int(r)): found[s, r] for s, r in zip(*found.nonzero(), strict=True)} == {
        (0, 3): 1,  # the brighter of two; z does not matter
        (14, 10): np.float32(1 / 255),  # black, but not empty
        (30, 3): 0.5,
    }


@rows("seed", range(3))
def test_bins_hold_the_largest_intensity(seed: int) -> None:
    points, intensities = random_scan(seed)
    expected = np.zeros((60, 20))
    for (x, y, _), intensity in zip(points.astype(np.float64), intensities, strict=True):
        sector = int(math.atan2(y, x) % (2 * math.pi) / (2 * math.pi) * 60)
        ring = int(math.hypot(x, y) / 3)
        expected[sector, ring] = max(expected[sector, ring], intensity, intensities.max() / 255)
    found = intensity_scan_context(points, intensities)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected.ravel() / expected.max(), rtol=1e-6)


@rows("turn", [1, 30, 59])
def test_a_turn_moves_the_sectors_of_intensities(turn: int) -> None:
    points, intensities = random_scan(turn)
    older, newer = (
        intensity_scan_context(each, intensities).reshape(60, 20)
        for each in (points, seen_after_turn(points, 2 * math.pi * turn / 60))
    )
    np.testing.assert_array_equal(newer, np.roll(older, -turn, axis=0))


def test_the_unit_of_intensities_does_not_matter() -> None:
    points, intensities = random_scan(9)
    np.testing.assert_allclose(
        intensity_scan_context(points, intensities * np.float32(256)),
        intensity_scan_context(points, intensities),
    )
