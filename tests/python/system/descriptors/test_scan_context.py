# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scan Context against numpy, written from the paper (Kim, Kim, IROS 2018, section III).

The coloured one against numpy, with CIELab written from CIE 15 and IEC 61966-2-1.
"""

import math
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from fusionslam import DataError, ShapeError
from fusionslam._core import ScanContextConfig

SECTORS, RINGS = 60, 20
Floats = NDArray[np.float32]


def random_cloud(rng: np.random.Generator, count: int = 2000, sector: float = 2 * np.pi) -> Floats:
    """Points whose azimuth and range keep away from the borders of bins."""
    turn = (rng.integers(0, round(sector / (2 * np.pi) * SECTORS), count) + 0.5) / SECTORS
    azimuth = 2 * np.pi * (turn + rng.uniform(-0.4, 0.4, count) / SECTORS)
    reach = (rng.integers(0, RINGS, count) + rng.uniform(0.1, 0.9, count)) * 4
    height = rng.uniform(-1.5, 8, count)
    return np.stack([reach * np.cos(azimuth), reach * np.sin(azimuth), height], 1).astype(
        np.float32
    )


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


def paper_distance(query: Floats, match: Floats) -> float:
    """Equations 6 and 7: the mean over the columns that are filled in both."""
    distances = []
    for turn in range(SECTORS):
        a, b = np.roll(columns(query), -turn, axis=0), columns(match)
        lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        both = lengths > 0
        if both.any():
            distances.append(1 - np.mean((a * b).sum(1)[both] / lengths[both]))
    return min(distances)


def our_distance(query: Floats, match: Floats) -> float:
    """The same, divided by the columns of the fuller one."""
    best = 0.0
    fuller = max(np.count_nonzero(columns(each).any(1)) for each in (query, match))
    for turn in range(SECTORS):
        a, b = np.roll(columns(query), -turn, axis=0), columns(match)
        lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        both = lengths > 0
        best = max(best, float(((a * b).sum(1)[both] / lengths[both]).sum()))
    return 1 - best / fuller


@pytest.mark.parametrize("seed", range(3))
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


@pytest.mark.parametrize("turn", [1, 7, 30, 59])
def test_a_turn_by_whole_sectors_is_found_and_changes_nothing(turn: int) -> None:
    points = random_cloud(np.random.default_rng(turn))
    yaw = 2 * np.pi * turn / SECTORS
    rotation = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    turned = (points.astype(np.float64) @ rotation.T).astype(np.float32)  # a robot turned left
    older, newer = (fusionslam.scan_context(each) for each in (points, turned))
    np.testing.assert_allclose(newer, np.roll(columns(older), -turn, axis=0).ravel(), rtol=1e-6)
    distance, found = fusionslam.compare_scan_contexts(newer, older)
    assert distance == pytest.approx(0, abs=1e-6)
    assert np.angle(np.exp(1j * (found - yaw))) == pytest.approx(0, abs=1e-9)


def test_distance_of_full_circles_is_the_papers() -> None:
    rng = np.random.default_rng(2)
    contexts = [random_context(rng) for _ in range(6)]
    for query in contexts:
        for match in contexts:
            distance, _ = fusionslam.compare_scan_contexts(query, match)
            assert distance == pytest.approx(paper_distance(query, match), abs=2e-6)


def test_narrow_views_are_measured_by_the_fuller_one() -> None:
    rng = np.random.default_rng(3)
    contexts = [random_context(rng, filled) for filled in (3, 14, 14, 40, 60)]
    for query in contexts:
        for match in contexts:
            distance, _ = fusionslam.compare_scan_contexts(query, match)
            assert distance == pytest.approx(our_distance(query, match), abs=2e-6)


def grey_world(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    means = colors.mean(axis=0, dtype=np.float64)
    return np.minimum(colors * (110 / means), 255).astype(np.uint8)


def cie_lab(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    """float64 (N, 3): L, a, b under D65 of sRGB."""
    values = rgb / 255
    linear = np.where(values > 0.04045, ((values + 0.055) / 1.055) ** 2.4, values / 12.92)
    xyz_from_rgb = [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
    ratio = linear @ np.transpose(xyz_from_rgb) / [0.95047, 1, 1.08883]
    x, y, z = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio * (29 / 6) ** 2 / 3 + 4 / 29).T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)


def reference_colored_context(
    points: Floats, colors: NDArray[np.uint8], height: float
) -> NDArray[np.float64]:
    """Sectors x (height, a, b) x rings, bin by bin."""
    heights = reference_context(points, height).reshape(SECTORS, RINGS).astype(np.float64)
    lab = cie_lab(grey_world(colors))
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


@pytest.mark.parametrize("seed", range(3))
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


@pytest.mark.parametrize("turn", [1, 30, 59])
def test_a_turn_by_whole_sectors_turns_the_colored_context(turn: int) -> None:
    rng = np.random.default_rng(turn)
    points = random_cloud(rng)
    colors = rng.integers(0, 256, (len(points), 3), dtype=np.uint8)
    yaw = 2 * np.pi * turn / SECTORS
    rotation = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    turned = (points.astype(np.float64) @ rotation.T).astype(np.float32)
    older, newer = (fusionslam.cscan_context(each, colors) for each in (points, turned))
    np.testing.assert_allclose(newer, np.roll(columns(older), -turn, axis=0).ravel(), rtol=1e-5)
    distance, found = fusionslam.compare_scan_contexts(newer, older)
    assert distance == pytest.approx(0, abs=1e-6)
    assert np.angle(np.exp(1j * (found - yaw))) == pytest.approx(0, abs=1e-9)


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


@pytest.mark.parametrize("rings", [1, 7, 20, 60, 72])
@pytest.mark.parametrize("window", [0, 5])
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
    for other in (fusionslam.DescriptorIndex.load(tmp_path / "a.index"), _pickled(index)):
        assert (other.metric, other.window, len(other)) == ("scan_context", 1, 4)
        for found, expected in zip(
            other.query(rows[2], k=3), index.query(rows[2], k=3), strict=True
        ):
            np.testing.assert_array_equal(found, expected)


def _pickled(index: fusionslam.DescriptorIndex) -> fusionslam.DescriptorIndex:
    copy: fusionslam.DescriptorIndex = pickle.loads(pickle.dumps(index))
    return copy


def test_every_instruction_set_gives_the_same_bits() -> None:
    program = (
        "import numpy as np, fusionslam, sys; rng = np.random.default_rng(6);"
        "rows = rng.uniform(0, 5, (30, 1200)).astype(np.float32);"
        "found = fusionslam.nearest(rows, rows, k=30, metric='scan_context');"
        "sys.stdout.buffer.write(found[0].tobytes() + found[1].tobytes())"
    )
    levels = ["baseline", "avx2", "avx512"]
    levels = levels[: levels.index(fusionslam.simd_level()) + 1]  # those of this machine
    outputs = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={"FUSIONSLAM_SIMD": level, "PYTHONPATH": ":".join(sys.path)},
            capture_output=True,
            check=True,
        ).stdout
        for level in levels
    }
    assert len(outputs) == 1
    assert len(outputs.pop()) == 30 * 30 * 12


def test_extreme_values_give_finite_distances() -> None:
    for scale in (1e-38, 1e-20, 1e30):
        context = random_context(np.random.default_rng(7)) * np.float32(scale)
        distance, _ = fusionslam.compare_scan_contexts(context, context)
        assert distance == pytest.approx(0, abs=1e-5)
    nothing = np.zeros(1200, np.float32)
    assert fusionslam.compare_scan_contexts(nothing, nothing)[0] == 1
    assert (
        fusionslam.compare_scan_contexts(nothing, random_context(np.random.default_rng(8)))[0] == 1
    )


def test_bad_input_is_refused() -> None:
    good = random_context(np.random.default_rng(9))
    with pytest.raises(ShapeError):
        fusionslam.compare_scan_contexts(good, good[:600])
    with pytest.raises(ShapeError):
        fusionslam.DescriptorIndex(1199, metric="scan_context")
    with pytest.raises(fusionslam.ConfigError):
        fusionslam.DescriptorIndex(1200, metric="cosine")
    with pytest.raises(DataError):
        fusionslam.compare_scan_contexts(good, np.full(1200, np.nan, np.float32))
    for cloud in (np.empty((0, 3), np.float32), np.full((5, 3), np.nan, np.float32)):
        with pytest.raises(DataError):
            fusionslam.scan_context(cloud)
    with pytest.raises(fusionslam.ConfigError):
        fusionslam.scan_context(np.ones((4, 3), np.float32), height=math.nan)
    with pytest.raises(ShapeError):
        fusionslam.cscan_context(np.ones((4, 3), np.float32), np.ones((3, 3), np.uint8))
    with pytest.raises(DataError):
        fusionslam.cscan_context(np.full((4, 3), -9, np.float32), np.ones((4, 3), np.uint8))
