# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Surface-shape histograms against numpy (Magnusson et al. 2009), and turns of a cloud."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from clouds import seen_after_turn
from fusionslam._core import NdtHistogramConfig, ndt_histogram
from rows import rows

BLOCKS, SHELLS, CLASSES = 4, 5, 11
CELL = 0.5
Floats = NDArray[np.float32]


def describe(points: Floats, ambiguity: float = 0.6) -> NDArray[np.float64]:
    """Alignments x shells x classes."""
    config = NdtHistogramConfig(cell=CELL, ambiguity=ambiguity)
    return ndt_histogram(points, config=config).reshape(BLOCKS, SHELLS, CLASSES).astype(np.float64)


def patch(
    rng: np.random.Generator, center: list[float], extent: list[float], count: int = 40
) -> NDArray[np.float64]:
    """Points about the middle of a cell of 0.5 m."""
    return np.array(center) + rng.uniform(-1, 1, (count, 3)) * extent


def surroundings(seed: int, azimuth: float = 0.0) -> Floats:
    """Ground, two rows of house fronts at a right angle, poles and bushes, all turned."""
    rng = np.random.default_rng(seed)
    ground = rng.uniform([-16, -16, -1.73], [16, 16, -1.72], (16000, 3))
    front = rng.uniform([-15, 8.12, -1.5], [15, 8.14, 4], (6000, 3))
    side = rng.uniform([12.12, -14, -1.5], [12.14, 6, 4], (4000, 3))
    poles = rng.uniform([-0.02, -0.02, -1.5], [0.02, 0.02, 3], (6, 150, 3))
    poles[..., :2] += rng.uniform(-10, 6, (6, 1, 2))
    bushes = rng.uniform(-0.8, 0.8, (5, 300, 3))
    bushes += rng.uniform([-12, -12, -1], [10, 6, 0], (5, 1, 3))
    points = np.concatenate([ground, front, side, *poles, *bushes])
    return seen_after_turn(points, -azimuth)


def cells(points: Floats) -> list[NDArray[np.float64]]:
    """The points of each cell that has five."""
    exact = points.astype(np.float64)
    _, number = np.unique(np.floor(exact / CELL), axis=0, return_inverse=True)
    sizes = np.bincount(number.ravel())
    parts = np.split(exact[np.argsort(number.ravel(), kind="stable")], np.cumsum(sizes)[:-1])
    return [part for part in parts if len(part) >= 5]


def reference(points: Floats, *azimuths: float) -> list[NDArray[np.float64]]:
    """The histograms of a cloud turned so that each azimuth lies along x."""
    half = math.sqrt(0.5)
    level = [[math.cos(a), math.sin(a), 0] for a in np.radians([0, 45, 90, 135])]
    slopes = [[half * math.cos(a), half * math.sin(a), half] for a in np.radians([0, 90, 180, 270])]
    axes = np.array([[0, 0, 1], *level, *slopes])
    parts = cells(points)
    means = np.array([cell.mean(axis=0) for cell in parts])
    offsets = [cell - mean for cell, mean in zip(parts, means, strict=True)]
    values, vectors = np.linalg.eigh([each.T @ each / len(each) for each in offsets])
    smallest, middle, largest = values.T
    shells = np.searchsorted([3, 6, 9, 15], np.linalg.norm(means, axis=1), side="right")
    x, y, z = vectors[:, :, 0].T
    found = []
    for azimuth in azimuths:
        c, s = math.cos(azimuth), math.sin(azimuth)
        faces = 1 + np.abs(axes @ [c * x + s * y, -s * x + c * y, z]).argmax(axis=0)
        kinds = np.where(smallest <= 0.1 * middle, faces, 10)
        kinds[middle <= 0.1 * largest] = 0
        counts = np.zeros((SHELLS, CLASSES))
        np.add.at(counts, (shells, kinds), 1)
        found.append(counts / counts.sum())
    return found


def test_five_cells_by_hand() -> None:
    """A pole, a patch of ground, two patches of walls and a bush, each in a cell and a shell."""
    rng = np.random.default_rng(0)
    cloud = np.concatenate(
        [
            patch(rng, [1.25, 0.25, 0.25], [0.01, 0.01, 0.2]),
            patch(rng, [0.25, 4.25, 0.25], [0.2, 0.2, 0.005]),
            patch(rng, [7.25, 0.25, 0.25], [0.005, 0.2, 0.2]),
            patch(rng, [0.25, 12.25, 0.25], [0.2, 0.2, 0.2]),
            patch(rng, [20.25, 0.25, 0.25], [0.2, 0.005, 0.2]),
        ]
    )
    found = describe(cloud.astype(np.float32))
    # The two walls are equally common: both are aligned, both ways.
    np.testing.assert_allclose(found.sum(axis=(1, 2)), 1)
    counted = {tuple(map(int, at)): found[0][tuple(at)] for at in np.argwhere(found[0])}
    assert counted == {
        (0, 0): pytest.approx(0.2),
        (1, 1): pytest.approx(0.2),
        (2, 2): pytest.approx(0.2),
        (3, 10): pytest.approx(0.2),
        (4, 4): pytest.approx(0.2),
    }
    assert (found[2, 2, 4], found[2, 4, 2]) == (pytest.approx(0.2), pytest.approx(0.2))


@pytest.mark.parametrize("azimuth", [0.35, -0.6])
def test_blocks_are_those_of_the_common_directions(azimuth: float) -> None:
    """The longer front looks along y, which is `azimuth` further; the shorter one is 70 % of it."""
    points = surroundings(1, azimuth)
    found = describe(points, ambiguity=0.5)
    across = azimuth + math.pi / 2
    turns = [direction + turn for direction in (across, azimuth) for turn in (0, math.pi)]
    for each in reference(points, *turns):
        assert min(np.abs(each - block).max() for block in found) < 2e-3


def test_without_walls_there_is_one_histogram() -> None:
    rng = np.random.default_rng(3)
    ground = rng.uniform([-16, -16, -1.73], [16, 16, -1.72], (9000, 3)).astype(np.float32)
    found = describe(ground)
    np.testing.assert_allclose(found[0], reference(ground, 0)[0], atol=1e-6)
    assert not found[1:].any()
    assert not found[0, :, 2:].any()  # lines, of a few points in a row, and planes


def test_a_rare_second_direction_is_not_aligned() -> None:
    points = surroundings(4)
    found = describe(points, ambiguity=1.0)
    np.testing.assert_allclose(found.sum(axis=(1, 2)), [1, 1, 0, 0], atol=1e-6)


@rows("degrees", [90, 180, 270])
def test_quarter_turns_leave_the_set(degrees: int) -> None:
    points = surroundings(5, azimuth=0.2)
    older = describe(points)
    newer = describe(seen_after_turn(points, math.radians(degrees)))
    for block in newer:
        assert min(np.abs(block - other).max() for other in older) < 2e-3


@rows("degrees", [20, 45, 163])
def test_other_turns_change_it_less_than_another_place(degrees: int) -> None:
    def apart(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
        pairs = [(x, y) for x in a for y in b if x.any() and y.any()]
        return min(float(np.linalg.norm(x - y)) for x, y in pairs)

    points = surroundings(6)
    here, turned = points, seen_after_turn(points, math.radians(degrees))
    there = surroundings(7) * np.float32([0.5, 0.5, 1])
    rows = [describe(each) for each in (here, turned, there)]
    assert apart(rows[0], rows[1]) < 0.5 * apart(rows[0], rows[2])
