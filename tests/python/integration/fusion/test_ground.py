# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ground fitted by segments, against a plain numpy version of the published algorithm."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import read_scan
from fusionslam import GroundSegmentsConfig
from fusionslam.errors import ConfigError, DataError, ShapeError
from project import PROJECT
from rows import rows


def road(seed: int, size: int = 6000) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """A road that falls, lies flat and rises, leaning to the side, with things on it."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-30, 30, size), rng.uniform(-12, 12, size)
    z = -1.7 + 0.03 * y + np.where(x < -10, -0.05 * (x + 10), np.where(x > 10, 0.08 * (x - 10), 0))
    things = rng.random(size) < 0.4
    z += np.where(things, rng.uniform(0.4, 4, size), rng.normal(0, 0.02, size))
    return np.stack([x, y, z], axis=1).astype(np.float32), things


def numpy_planes(points: NDArray[np.float32], config: Any) -> list[NDArray[np.float64]]:
    """One plane a segment by singular value decomposition, without what guards the real one."""
    borders = np.linspace(points[:, 0].min(), points[:, 0].max(), config.segments + 1)
    place = np.clip(np.searchsorted(borders, points[:, 0], "right") - 1, 0, config.segments - 1)
    planes = []
    for segment in range(config.segments):
        chosen = points[place == segment].astype(np.float64)
        count = max(config.lowest, int(config.lowest_share * len(chosen)))
        start = np.sort(chosen[:, 2])[count // 2]
        ground = np.abs(chosen[:, 2] - start) < config.seed_height
        for _ in range(config.iterations):
            mean = chosen[ground].mean(axis=0)
            normal = np.linalg.svd(chosen[ground] - mean, full_matrices=False)[2][2]
            normal *= np.sign(normal[2])
            ground = np.abs((chosen - mean) @ normal) < config.distance / 2
        planes.append(np.append(normal, -normal @ mean))
    return planes


@rows("seed", range(3))
@rows("segments", [1, 3, 6])
def test_planes_are_those_of_a_plain_numpy_version(seed: int, segments: int) -> None:
    points, _ = road(seed)
    config = GroundSegmentsConfig(segments=segments, max_step=10.0)
    kept, planes, borders = fusionslam.remove_ground_segments(points, config=config)
    assert planes.shape == (segments, 4) and borders.shape == (segments + 1,)
    assert np.abs(planes - numpy_planes(points, config)).max() < 1e-6
    ends = points[:, 0].min(), points[:, 0].max()
    assert borders == pytest.approx(np.linspace(*ends, segments + 1), abs=1e-5)
    segment = np.clip(np.searchsorted(borders, points[:, 0], "right") - 1, 0, segments - 1)
    heights = np.einsum("ij,ij->i", planes[segment, :3], points) + planes[segment, 3]
    assert np.array_equal(kept, np.flatnonzero(heights >= config.distance))


@rows("seed", range(3))
def test_the_things_on_a_winding_road_are_kept_and_the_road_is_not(seed: int) -> None:
    points, things = road(seed)
    kept, _, _ = fusionslam.remove_ground_segments(points)
    assert np.array_equal(kept, np.flatnonzero(things))
    # A single plane loses much of it.
    coarse, _ = fusionslam.remove_ground_plane(points)
    assert len(np.setxor1d(coarse, np.flatnonzero(things))) > 300


def test_more_ghosts_than_the_published_twenty_do_no_harm() -> None:
    points, things = road(5)
    ghosts = np.column_stack([points[:40, :2], np.full(40, -6, np.float32)])
    cloud = np.concatenate([points, ghosts])
    config = GroundSegmentsConfig(lowest_share=0.05)
    kept, _, _ = fusionslam.remove_ground_segments(cloud, config=config)
    assert np.array_equal(kept, np.flatnonzero(things))


def test_the_ground_of_kitti_scans_lies_level_under_the_car(test_data: Path) -> None:
    for scan in ("00/velodyne/000000.bin", "00/velodyne/000198.bin", "08/velodyne/000720.bin"):
        points = read_scan(test_data / "kitti/sequences" / scan)
        kept, plane = fusionslam.remove_ground_plane(points)
        assert np.degrees(np.arccos(plane[2] / np.linalg.norm(plane[:3]))) < 3
        by_segments, planes, borders = fusionslam.remove_ground_segments(points)
        for found in (plane, planes[np.searchsorted(borders, 0) - 1]):
            assert -found[3] / found[2] == pytest.approx(-1.73, abs=0.1)
        for above in (kept, by_segments):
            assert 0.3 < len(above) / len(points) < 0.75
        assert np.array_equal(kept, fusionslam.remove_ground_plane(points)[0])
        assert np.array_equal(planes, fusionslam.remove_ground_segments(points)[1])


def test_a_cloud_without_ground_keeps_its_points() -> None:
    rng = np.random.default_rng(6)
    wall = rng.uniform([7, -5, 0], [7.02, 5, 4], (2000, 3)).astype(np.float32)
    for cloud in (wall, wall[:5], wall[:0]):
        kept, planes, _ = fusionslam.remove_ground_segments(cloud)
        assert len(kept) == len(cloud) and not planes.any()


def test_what_cannot_be_cut_into_segments_is_refused() -> None:
    points, _ = road(7)
    with pytest.raises(ConfigError, match=r"segments\.driving"):
        fusionslam.remove_ground_segments(points, up="x")
    with pytest.raises(ConfigError, match="'w'"):
        fusionslam.remove_ground_segments(points, up="w")
    with pytest.raises(ConfigError, match=r"segments\.iterations"):
        GroundSegmentsConfig(iterations=0)
    with pytest.raises(ConfigError, match=r"segments\.driving .*x, y, z"):
        GroundSegmentsConfig(driving="up")
    points[3, 1] = np.nan
    with pytest.raises(DataError, match="point 3"):
        fusionslam.remove_ground_segments(points)
    with pytest.raises(ShapeError, match=r"\(N, 3\)"):
        fusionslam.remove_ground_segments(points[:, :2])


def test_the_comparison_on_simulated_truth_counts_what_is_ground(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A LiDAR over a floor with a box on it: every way finds all of the floor and nothing else."""
    pytest.importorskip("embreex")
    monkeypatch.syspath_prepend(str(PROJECT))
    ground = importlib.import_module("benchmarks.accuracy.ground")
    from fusionslam.sim.lidar import LidarConfig
    from fusionslam.sim.mesh import Paint, box
    from fusionslam.sim.world import Part, scene_of

    paint = Paint(0)
    floor = Part("floor", box((-30, -30, -1), (30, 30, 0), paint), is_ground=True)
    crate = Part("crate", box((4, -2, 0.3), (6, 2, 2), paint))
    scene = scene_of([floor, crate], [np.full((8, 8, 4), 128, np.uint8)])
    lifted = np.eye(4)
    lifted[2, 3] = 1.0
    lidar = LidarConfig(rings=16, azimuths=180, noise_m=0.01)
    case = ground.Case("made", "lidar", scene, lidar, lifted, np.eye(4)[None], 0.2, "scan")
    (points, is_ground), *_ = ground.scans(case)
    assert np.array_equal(is_ground, points[:, 2] < 0.15) and 0 < is_ground.mean() < 1
    row = ground.judge_case(case)
    assert [cell.split(",")[0] for cell in row[4:]] == ["1.000 / 1.000"] * 3
    score = ground.Score()
    score.add(np.array([0, 1]), np.array([True, False, True, False, True]))  # 2, 3 and 4 are gone
    assert (score.precision, score.recall) == (2 / 3, 2 / 3)
