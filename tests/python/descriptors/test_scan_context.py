# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scan Context against numpy, written from the paper (Kim, Kim, IROS 2018, section III)."""

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


@pytest.mark.parametrize("rings", [1, 7, 20])
@pytest.mark.parametrize("window", [0, 5])
def test_index_and_tables_agree_with_pair_by_pair(rings: int, window: int) -> None:
    rng = np.random.default_rng(4)
    rows = rng.uniform(0, 5, (25, SECTORS * rings)).astype(np.float32)
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
    outputs = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={"FUSIONSLAM_SIMD": level, "PYTHONPATH": ":".join(sys.path)},
            capture_output=True,
            check=True,
        ).stdout
        for level in ("baseline", "avx2", "avx512")
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
