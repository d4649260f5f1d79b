# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ground, voxels and invalid points against plain NumPy."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from benchmarks.accuracy import ground
from clouds import ground_and_things, read_scan, scene
from fusionslam import GroundSegmentsConfig
from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.sim.lidar import LidarConfig
from fusionslam.sim.mesh import Paint, box
from fusionslam.sim.world import Part, scene_of
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
    for up, message in (("x", r"segments\.driving"), ("w", "'w'")):
        with pytest.raises(ConfigError, match=message):
            fusionslam.remove_ground_segments(points, up=up)
    for name, value, words in (("iterations", 0, ""), ("driving", "up", " .*x, y, z")):
        with pytest.raises(ConfigError, match=rf"segments\.{name}{words}"):
            GroundSegmentsConfig(**{name: value})
    points[3, 1] = np.nan
    with pytest.raises(DataError, match="point 3"):
        fusionslam.remove_ground_segments(points)
    with pytest.raises(ShapeError, match=r"\(N, 3\)"):
        fusionslam.remove_ground_segments(points[:, :2])


def test_the_comparison_on_simulated_truth_counts_what_is_ground() -> None:
    """A LiDAR over a floor with a box on it: every way finds all of the floor and nothing else."""
    pytest.importorskip("embreex")
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


UP_AXES = ("x", "y", "z", "-x", "-y", "-z")


def towards(up: str, points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Points given with z up, turned so that ``up`` is up."""
    axis, sign = "xyz".index(up[-1]), -1 if up.startswith("-") else 1
    turned = np.roll(points, axis - 2, axis=1)
    turned[:, axis] *= sign
    return turned.astype(np.float32)


@rows("up", UP_AXES)
def test_points_above_a_height_are_those_of_a_numpy_comparison(up: str) -> None:
    points = ground_and_things(10)[0]
    kept = fusionslam.above_height(towards(up, points), -1.0, up=up)
    assert np.array_equal(kept, np.flatnonzero(points[:, 2].astype(np.float32) > -1.0))
    assert kept.dtype == np.int64


@rows("up", UP_AXES)
def test_the_ground_plane_is_found_for_every_up_axis(up: str) -> None:
    points, is_floor = ground_and_things(11)
    turned = towards(up, points)
    kept, plane = fusionslam.remove_ground_plane(turned, up=up)
    assert np.array_equal(kept, np.flatnonzero(~is_floor))
    expected = towards(up, np.array([[-0.02, 0, 1]]) / np.hypot(0.02, 1))[0]
    assert plane[:3] == pytest.approx(expected, abs=0.01)
    assert plane[3] == pytest.approx(1.7, abs=0.1)
    distances = np.abs(turned @ plane[:3] + plane[3])
    assert np.array_equal(kept, np.flatnonzero(distances > 0.2))


def test_a_wall_is_no_ground_and_nothing_is_printed(capfd: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(12)
    wall = rng.uniform([-20, -0.01, -2], [20, 0.01, 6], (2000, 3)).astype(np.float32)
    config = fusionslam.GroundPlaneConfig(distance=0.001, max_tilt=5)
    kept, plane = fusionslam.remove_ground_plane(wall, config=config)
    assert len(kept) > 1900
    assert not plane.any() or plane[2] > np.cos(np.radians(5)) - 1e-6
    kept, plane = fusionslam.remove_ground_plane(np.ones((10, 3), np.float32))  # no plane at all
    assert len(kept) == 10 and not plane.any()
    assert capfd.readouterr() == ("", "")


def test_ground_removal_refuses_what_it_cannot_do() -> None:
    points = ground_and_things(13)[0].astype(np.float32)
    with pytest.raises(ConfigError, match=r"'w'.* x, y, z, -x, -y, -z"):
        fusionslam.above_height(points, 0.0, up="w")
    with pytest.raises(ConfigError, match="height"):
        fusionslam.above_height(points, float("nan"))
    with pytest.raises(DataError, match="2 points"):
        fusionslam.remove_ground_plane(points[:2])


@rows("size", [0.3, 1.0, 7.5])
def test_voxels_are_those_of_numpy(size: float) -> None:
    points, _ = scene(14)
    colors = np.random.default_rng(14).integers(0, 256, points.shape, dtype=np.uint8)
    cubes = np.floor(points.astype(np.float64) / size).astype(int)
    _, first, group, counts = np.unique(
        cubes, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    order = np.argsort(first)  # cubes in the order in which they are first met
    sums = np.zeros((len(first), 6))
    np.add.at(sums, group.ravel(), np.c_[points.astype(np.float64), colors])
    means = (sums / counts[:, None])[order]
    given_points, given_colors, indices = fusionslam.voxel_downsample(points, colors, size=size)
    assert np.array_equal(indices, first[order])
    assert np.abs(given_points - means[:, :3]).max() < 1e-5
    assert np.abs(given_colors - means[:, 3:]).max() <= 0.5 + 1e-9
    plain, none, same_indices = fusionslam.voxel_downsample(points, size=size)
    assert np.array_equal(plain, given_points) and np.array_equal(indices, same_indices)
    assert none.shape == (0, 3)


@rows(
    "size, error",
    [(0.0, ConfigError), (-1.0, ConfigError), (np.nan, ConfigError), (1e-9, DataError)],
)
def test_voxels_of_no_size_or_far_too_many_are_refused(size: float, error: type[Exception]) -> None:
    with pytest.raises(error, match="voxel"):
        fusionslam.voxel_downsample(scene(15)[0], size=size)


def test_invalid_points_are_dropped_and_the_rest_keep_their_order() -> None:
    points, _ = scene(17)
    points[[3, 700], 0], points[[3, 41], 2] = np.nan, -np.inf
    kept = fusionslam.drop_invalid(points)
    assert np.array_equal(kept, np.delete(np.arange(len(points)), [3, 41, 700]))
