# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""RING against numpy (Lu et al., IROS 2022), and what turns and moves change."""

import math

import numpy as np
from numpy.typing import NDArray

from clouds import cells_cloud, seen_after_turn, walls
from fusionslam._core import RingConfig, ring
from rows import rows

SIDE, ANGLES, FREQUENCIES = 120, 120, 60
CELL = 140 / SIDE
Floats = NDArray[np.float32]


def random_cloud(seed: int, reach: int = 40) -> Floats:
    return cells_cloud(seed, CELL, reach, [-1.8, 0.0, 3.0])


def reference(points: Floats) -> NDArray[np.float64]:
    high = points[points[:, 2] + 2 >= 0.5].astype(np.float64)
    places = np.unique(np.floor(high[:, :2] / CELL), axis=0) + 0.5
    places = places[np.hypot(*places.T) <= (SIDE - 1) / 2]
    sinogram = np.zeros((ANGLES, SIDE))
    lines = np.arange(SIDE) - (SIDE - 1) / 2
    for angle in range(ANGLES):
        theta = math.pi * angle / ANGLES
        offsets = places @ [math.cos(theta), math.sin(theta)]
        shares = np.maximum(0, 1 - np.abs(offsets[:, None] - lines))
        sinogram[angle] = shares.sum(axis=0)
    return np.abs(np.fft.rfft(sinogram, axis=1))[:, 1:]


def by_angle(row: Floats) -> NDArray[np.float64]:
    return row.reshape(ANGLES, FREQUENCIES).astype(np.float64)


def likeness(query: Floats, match: Floats) -> NDArray[np.float64]:
    """Cosines at each turn of the query by a multiple of 1.5 degrees."""
    a, b = by_angle(query), by_angle(match)
    norm = np.linalg.norm(a) * np.linalg.norm(b)
    return np.array([(a * np.roll(b, -turn, axis=0)).sum() / norm for turn in range(ANGLES)])


@rows("seed", range(3))
def test_it_is_the_spectrum_of_the_sinogram(seed: int) -> None:
    points = random_cloud(seed, reach=60)  # corners are left out
    found = ring(points)
    assert found.dtype == np.float32
    assert found.shape == (ANGLES * FREQUENCIES,)
    np.testing.assert_allclose(by_angle(found), reference(points), atol=1e-4)
    half = ring(points * np.float32([0.5, 0.5, 1]), config=RingConfig(max_range=35.0))
    np.testing.assert_array_equal(half, found)


def test_two_posts_interfere_as_by_hand() -> None:
    """Two cells d apart along x: 2 |cos(pi k d / 120)| along x, 2 times a cell's own along y."""
    distance = 14
    posts = np.array([[0.5, 0.5, 0], [0.5 + distance, 0.5, 0]], np.float32) * np.float32(CELL)
    found = by_angle(ring(posts))
    k = np.arange(1, FREQUENCIES + 1)
    np.testing.assert_allclose(
        found[0], 2 * np.abs(np.cos(math.pi * k * distance / SIDE)), atol=1e-5
    )
    np.testing.assert_allclose(found[ANGLES // 2], 2, atol=1e-5)


@rows("shift", [(1, 0), (-4, 7), (8, 8)])
def test_a_shift_by_cells_changes_it_little(shift: tuple[int, int]) -> None:
    points = random_cloud(7, reach=30)  # nothing leaves the image
    moved = points + np.float32([shift[0] * CELL, shift[1] * CELL, 0])
    found, expected = ring(moved), ring(points)
    # Along x and y, offsets move by whole lines.
    for angle in (0, ANGLES // 2):
        np.testing.assert_allclose(by_angle(found)[angle], by_angle(expected)[angle], atol=1e-3)
    # Elsewhere a cell is shared by two lines in other parts, which blurs the highest frequencies.
    np.testing.assert_allclose(
        by_angle(found)[:, :20], by_angle(expected)[:, :20], atol=0.03 * by_angle(expected).max()
    )
    likenesses = likeness(found, expected)
    assert likenesses.argmax() == 0
    assert likenesses[0] > 0.99


@rows("degrees", [90, 180, 270])
def test_quarter_turns_move_the_angles(degrees: int) -> None:
    points = random_cloud(8)
    turned = ring(seen_after_turn(points, math.radians(degrees)))
    expected = np.roll(by_angle(ring(points)), -degrees * 2 // 3, axis=0)
    np.testing.assert_allclose(by_angle(turned), expected, atol=1e-3)


@rows("degrees", [3, 45, 120])
def test_a_turn_and_a_move_are_found_as_a_turn(degrees: int) -> None:
    points, other = walls(9), walls(10)
    moved = seen_after_turn(points - np.float32([5, -3, 0]), math.radians(degrees))
    same = likeness(ring(moved), ring(points))
    assert same.argmax() == degrees * 2 // 3
    assert same.max() > 0.95
    assert same.max() > likeness(ring(moved), ring(other)).max() + 0.02
