# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scan Context against numpy, written from the paper (Kim, Kim, IROS 2018, section III), and kin.

The coloured one against numpy, with CIELab written from CIE 15 and IEC 61966-2-1; the contexts of
Scan Context++, and Intensity Scan Context (Wang, Wang, Xie, ICRA 2020).
"""

import math
import pickle
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import cie_lab, polar_cloud, seen_after_turn
from fusionslam import DataError
from fusionslam._core import (
    ScanContextCartesianConfig,
    ScanContextConfig,
    ScanContextPolarConfig,
    intensity_scan_context,
    scan_context_cartesian,
    scan_context_polar,
)
from rows import rows

SECTORS, RINGS = 60, 20
Floats = NDArray[np.float32]


def random_cloud(rng: np.random.Generator) -> Floats:
    """Points whose azimuth and range keep away from the borders of bins."""
    return polar_cloud(rng, SECTORS, RINGS, 80)


def random_context(rng: np.random.Generator, filled: int = SECTORS) -> Floats:
    heights = rng.uniform(0, 10, (SECTORS, RINGS)) * (rng.uniform(size=(SECTORS, RINGS)) < 0.3)
    heights[:, 0] += 0.1  # no sector is empty by chance
    heights[filled:] = 0
    return heights.astype(np.float32).ravel()


def reference_context(points: Floats, height: float) -> Floats:
    context = np.zeros((SECTORS, RINGS))
    for x, y, z in points.astype(np.float64):
        ring = math.hypot(x, y) / 80 * RINGS
        if ring < RINGS:
            sector = int(math.atan2(y, x) % (2 * math.pi) / (2 * math.pi) * SECTORS)
            context[sector, int(ring)] = max(context[sector, int(ring)], z + height)
    return context.astype(np.float32).ravel()


def columns(context: Floats) -> NDArray[np.float64]:
    return context.reshape(SECTORS, -1).astype(np.float64)


def cosines(query: Floats, match: Floats) -> list[NDArray[np.float64]]:
    """Of the columns that are filled in both, for each turn of the query."""
    found = []
    for turn in range(SECTORS):
        a, b = np.roll(columns(query), -turn, axis=0), columns(match)
        lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        found.append((a * b).sum(1)[lengths > 0] / lengths[lengths > 0])
    return found


def paper_distance(query: Floats, match: Floats) -> float:
    """Equations 6 and 7: the mean over the columns that are filled in both."""
    return min(1 - float(each.mean()) for each in cosines(query, match) if len(each))


def our_distance(query: Floats, match: Floats) -> float:
    """The same, divided by the columns of the fuller one."""
    fuller = max(np.count_nonzero(columns(each).any(1)) for each in (query, match))
    return min(1 - float(each.sum()) / fuller for each in cosines(query, match))


@rows("seed", range(3))
def test_bins_hold_the_highest_point_above_the_ground(seed: int) -> None:
    points = random_cloud(np.random.default_rng(seed))
    found = fusionslam.scan_context(points, height=1.7)
    np.testing.assert_allclose(found, reference_context(points, 1.7), rtol=1e-6)


def test_sectors_begin_at_x_and_go_towards_y() -> None:
    points = np.array([[10, 0.1, 1], [0.1, 30, 2], [-10, -0.1, 3], [-0.1, -70, 4]], np.float32)
    found = fusionslam.scan_context(points, height=0).reshape(SECTORS, RINGS)
    assert {(int(s), int(r)): found[s, r] for s, r in zip(*found.nonzero(), strict=True)} == {
        (0, 2): 1,
        (14, 7): 2,
        (30, 2): 3,
        (44, 17): 4,
    }


def test_points_out_of_range_and_below_the_ground_do_not_count() -> None:
    points = np.array([[10, 0.1, -1.9], [10, 0.1, -2.5], [90, 1, 5]], np.float32)
    found = fusionslam.scan_context(points)
    assert np.flatnonzero(found).tolist() == [2]
    assert found[2] == pytest.approx(0.1)
    with pytest.raises(DataError):
        fusionslam.scan_context(points[1:])


def test_configuration_sets_rings_and_range() -> None:
    points = random_cloud(np.random.default_rng(1))
    found = fusionslam.scan_context(points, config=ScanContextConfig(rings=10, max_range=40.0))
    assert found.shape == (SECTORS * 10,)
    np.testing.assert_array_equal(
        found.reshape(SECTORS, 10), fusionslam.scan_context(points).reshape(SECTORS, RINGS)[:, :10]
    )


@rows("turn", [1, 7, 30, 59])
def test_a_turn_by_whole_sectors_is_found_and_changes_nothing(turn: int) -> None:
    rng = np.random.default_rng(turn)
    points = random_cloud(rng)
    colors = rng.integers(0, 256, (len(points), 3), dtype=np.uint8)
    yaw = 2 * np.pi * turn / SECTORS
    turned = seen_after_turn(points, yaw)
    for describe in (
        fusionslam.scan_context,
        lambda cloud: fusionslam.cscan_context(cloud, colors),
    ):
        older, newer = describe(points), describe(turned)
        np.testing.assert_allclose(newer, np.roll(columns(older), -turn, axis=0).ravel(), rtol=1e-5)
        distance, found = fusionslam.compare_scan_contexts(newer, older)
        assert distance == pytest.approx(0, abs=1e-6)
        assert np.angle(np.exp(1j * (found - yaw))) == pytest.approx(0, abs=1e-9)


@rows("filled, expected", [([60] * 4, paper_distance), ([3, 14, 40, 60], our_distance)])
def test_full_circles_are_as_far_as_in_the_paper_and_narrow_views_measured_by_the_fuller(
    filled: list[int], expected: Callable[[Floats, Floats], float]
) -> None:
    rng = np.random.default_rng(2)
    contexts = [random_context(rng, count) for count in filled]
    for query, match in product(contexts, repeat=2):
        distance, _ = fusionslam.compare_scan_contexts(query, match)
        assert distance == pytest.approx(expected(query, match), abs=2e-6)


def reference_colored_context(
    points: Floats, colors: NDArray[np.uint8], height: float
) -> NDArray[np.float64]:
    """Sectors x (height, a, b) x rings, bin by bin."""
    heights = reference_context(points, height).reshape(SECTORS, RINGS).astype(np.float64)
    means = colors.mean(axis=0, dtype=np.float64)
    lab = cie_lab(np.minimum(colors * (110 / means), 255).astype(np.uint8))  # of a grey world
    x, y, z = points.T.astype(np.float64)
    sector = np.floor(np.arctan2(y, x) % (2 * np.pi) / (2 * np.pi) * SECTORS)
    ring = np.floor(np.hypot(x, y) / 4)
    context = np.zeros((SECTORS, 3, RINGS))
    context[:, 0] = heights / np.sqrt(np.mean(heights[heights > 0] ** 2))
    for s in range(SECTORS):
        for r in range(RINGS):
            inside = (sector == s) & (ring == r) & (z + height > 0)
            if inside.any():
                _, a, b = lab[inside].mean(axis=0)
                context[s, 1:, r] = 2 * np.array([a, b]) / (math.hypot(a, b) + 5)
    return context


@rows("seed", range(3))
def test_colors_are_mean_hues_beside_the_heights(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = random_cloud(rng)
    colors = rng.integers(0, 256, (len(points), 3), dtype=np.uint8)
    found = fusionslam.cscan_context(points, colors, height=1.7).reshape(SECTORS, 3, RINGS)
    expected = reference_colored_context(points, colors, 1.7)
    np.testing.assert_allclose(found[:, 0], expected[:, 0], rtol=1e-6)
    np.testing.assert_allclose(found, expected, atol=4e-3)


def test_a_colored_context_by_hand() -> None:
    """One red and one blue wall, 3 and 4 m high: grey world makes the channels 0 and 220."""
    points = np.array([[10, 1, 1], [10, 1, 0.5], [-1, 30, 2], [-1, 30, -3]], np.float32)
    colors = np.array([[255, 0, 0], [255, 0, 0], [0, 0, 255], [0, 0, 255]], np.uint8)
    found = fusionslam.cscan_context(points, colors).reshape(SECTORS, 3, RINGS)
    assert set(zip(*(each.tolist() for each in found[:, 0].nonzero()), strict=True)) == {
        (0, 2),
        (15, 7),
    }
    unit = math.sqrt((3**2 + 4**2) / 2)
    assert found[0, 0, 2] == pytest.approx(3 / unit)
    assert found[15, 0, 7] == pytest.approx(4 / unit)
    # Linear 220 is 0.7157. X, Y, Z over white of red: 0.3105, 0.1522, 0.0127; their cube roots:
    # 0.6772, 0.5339, 0.2332. Of blue: 0.1359, 0.0517, 0.6247; 0.5141, 0.3725, 0.8548.
    red, blue = np.array([71.6, 60.1]), np.array([70.8, -96.5])
    for (a, b), bin_found in ((red, found[0, 1:, 2]), (blue, found[15, 1:, 7])):
        np.testing.assert_allclose(
            bin_found, 2 * np.array([a, b]) / (math.hypot(a, b) + 5), atol=2e-3
        )


def test_exposure_and_tint_change_a_colored_context_little_and_other_paint_much() -> None:
    rng = np.random.default_rng(11)
    points = random_cloud(rng)
    paint = rng.uniform(20, 200, (SECTORS, 3))
    sector = np.floor(np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi) / (2 * np.pi) * SECTORS)

    def context(colors: NDArray[np.float64]) -> Floats:
        return fusionslam.cscan_context(points, colors[sector.astype(int)].astype(np.uint8))

    known = context(paint)
    darker, _ = fusionslam.compare_scan_contexts(context(paint * [0.7, 0.6, 0.8]), known)
    other, _ = fusionslam.compare_scan_contexts(context(paint[::-1]), known)
    assert darker < 0.02 < 0.2 < other


def test_a_grey_cloud_is_compared_by_its_heights() -> None:
    rng = np.random.default_rng(12)
    clouds = [random_cloud(rng) for _ in range(2)]
    greys = [rng.integers(0, 256, (len(each), 1)).repeat(3, 1).astype(np.uint8) for each in clouds]
    plain = fusionslam.compare_scan_contexts(*map(fusionslam.scan_context, clouds))
    colored = fusionslam.compare_scan_contexts(*map(fusionslam.cscan_context, clouds, greys))
    assert colored == pytest.approx(plain, abs=1e-4)


@rows("rings, window", [(1, 5), (7, 0), (20, 5), (60, 0), (72, 5)])
def test_index_and_tables_agree_with_pair_by_pair(rings: int, window: int) -> None:
    rng = np.random.default_rng(4)
    rows = rng.uniform(0, 5, (25, SECTORS * rings)).astype(np.float32)
    rows[20:] -= 2  # hues have both signs
    rows[9] = rows[3]
    index = fusionslam.DescriptorIndex(rows.shape[1], window=window, metric="scan_context")
    tabled, tabled_distances = fusionslam.nearest_causal(
        rows, window=window, k=4, metric="scan_context"
    )
    everywhere, _ = fusionslam.nearest(rows, rows, k=4, metric="scan_context")
    for i, row in enumerate(rows):
        distances = [fusionslam.compare_scan_contexts(row, other)[0] for other in rows]
        order = np.argsort(distances, kind="stable")
        np.testing.assert_array_equal(everywhere[i], order[:4])
        expected = [j for j in order if j < i - window][:4]
        found, found_distances = index.query(row, k=4)
        assert found.tolist() == expected
        np.testing.assert_array_equal(found_distances, [np.float32(distances[j]) for j in expected])
        assert tabled[i, : len(expected)].tolist() == expected
        np.testing.assert_array_equal(tabled_distances[i, : len(expected)], found_distances)
        assert (tabled[i, len(expected) :] == -1).all()
        index.add(row)


def test_an_index_keeps_its_metric(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    rows = [random_context(rng) for _ in range(4)]
    index = fusionslam.DescriptorIndex(len(rows[0]), window=1, metric="scan_context")
    for row in rows:
        index.add(row)
    index.save(tmp_path / "a.index")
    pickled: fusionslam.DescriptorIndex = pickle.loads(pickle.dumps(index))
    for other in (fusionslam.DescriptorIndex.load(tmp_path / "a.index"), pickled):
        assert (other.metric, other.window, len(other)) == ("scan_context", 1, 4)
        for found, expected in zip(
            other.query(rows[2], k=3), index.query(rows[2], k=3), strict=True
        ):
            np.testing.assert_array_equal(found, expected)


def test_extreme_values_give_finite_distances() -> None:
    for scale in (1e-38, 1e-20, 1e30):
        context = random_context(np.random.default_rng(7)) * np.float32(scale)
        distance, _ = fusionslam.compare_scan_contexts(context, context)
        assert distance == pytest.approx(0, abs=1e-5)
    nothing = np.zeros(1200, np.float32)
    for other in (nothing, random_context(np.random.default_rng(8))):
        assert fusionslam.compare_scan_contexts(nothing, other)[0] == 1


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
