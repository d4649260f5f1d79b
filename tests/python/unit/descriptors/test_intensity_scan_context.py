# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Intensity Scan Context against numpy (Wang, Wang, Xie, ICRA 2020), and turns of a cloud."""

import math

import numpy as np
from numpy.typing import NDArray

from clouds import polar_cloud, seen_after_turn
from fusionslam._core import intensity_scan_context
from rows import rows

SECTORS, RINGS = 60, 20
Floats = NDArray[np.float32]


def random_scan(seed: int) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    points = polar_cloud(rng, SECTORS, RINGS, 60)
    return points, rng.uniform(0, 200, len(points)).astype(np.float32)


def test_a_context_by_hand() -> None:
    points = [[10, 0.1, 1], [10, 0.2, -9], [0.1, 30, 2], [-10, -0.1, 3], [70, 1, 0]]
    intensities = [3, 8, 0, 4, 99]
    found = intensity_scan_context(
        np.array(points, np.float32), np.array(intensities, np.float32)
    ).reshape(SECTORS, RINGS)
    assert {(int(s), int(r)): found[s, r] for s, r in zip(*found.nonzero(), strict=True)} == {
        (0, 3): 1,  # the brighter of two; z does not matter
        (14, 10): np.float32(1 / 255),  # black, but not empty
        (30, 3): 0.5,
    }


@rows("seed", range(3))
def test_bins_hold_the_largest_intensity(seed: int) -> None:
    points, intensities = random_scan(seed)
    expected = np.zeros((SECTORS, RINGS))
    for (x, y, _), intensity in zip(points.astype(np.float64), intensities, strict=True):
        sector = int(math.atan2(y, x) % (2 * math.pi) / (2 * math.pi) * SECTORS)
        ring = int(math.hypot(x, y) / 3)
        expected[sector, ring] = max(expected[sector, ring], intensity, intensities.max() / 255)
    found = intensity_scan_context(points, intensities)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected.ravel() / expected.max(), rtol=1e-6)


@rows("turn", [1, 30, 59])
def test_a_turn_by_sectors_moves_the_sectors(turn: int) -> None:
    points, intensities = random_scan(turn)
    older, newer = (
        intensity_scan_context(each, intensities).reshape(SECTORS, RINGS)
        for each in (points, seen_after_turn(points, 2 * math.pi * turn / SECTORS))
    )
    np.testing.assert_array_equal(newer, np.roll(older, -turn, axis=0))


def test_the_unit_of_intensities_does_not_matter() -> None:
    points, intensities = random_scan(9)
    np.testing.assert_allclose(
        intensity_scan_context(points, intensities * np.float32(256)),
        intensity_scan_context(points, intensities),
    )
