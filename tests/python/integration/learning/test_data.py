# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes, ModelNet's files and the clouds that networks are given."""

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trimesh import Trimesh

from fusionslam.errors import ConfigError, DataError, ShapeError
from fusionslam.learning.modelnet import read_modelnet, read_voxels
from fusionslam.learning.procedural_shapes import SHAPES, box, ellipsoid, sample_points, torus
from fusionslam.learning.shape_sets import ProceduralConfig, ShapeSet, generate_shapes, join_sets
from fusionslam.learning.training_data import load_shapes
from fusionslam.views.second_stage.architecture import PointNetConfig
from fusionslam.views.second_stage.inputs import (
    AugmentConfig,
    augment,
    network_input,
    resample,
    scale_to_sphere,
)
from refusals import refuses
from rows import rows

CUBE = """{header}8 6 0
0 0 0
1 0 0
1 1 0
0 1 0
0 0 1
1 0 1
1 1 1
0 1 1
4 0 1 2 3
4 4 5 6 7
4 0 1 5 4
4 1 2 6 5
4 2 3 7 6
4 3 0 4 7
"""

ROBOT = PointNetConfig(normalisation="robot", range_m=2.0, colors=True)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def write_hdf5(folder: Path, classes: list[int], points: int = 40) -> None:
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    (folder / "shape_names.txt").write_text("airplane\nbathtub\n")
    # As the authors' lists do, with the folder in which they worked.
    listed = "data/modelnet40_ply_hdf5_2048/ply_data_train0.h5\n"
    (folder / "train_files.txt").write_text(listed)
    with h5py.File(folder / "ply_data_train0.h5", "w") as stored:
        data = rng(1).normal(size=(len(classes), points, 3))
        data[:, :, 1] = np.abs(data[:, :, 1])  # y is up there
        stored["data"] = data.astype(np.float32)
        stored["label"] = np.array(classes, np.uint8)[:, None]


def write_off(folder: Path, name: str, part: str, text: str) -> Path:
    path = folder / name / part / f"{name}_0001.off"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    return path


@rows("name", SHAPES)
def test_every_shape_stands_upright_varies_and_repeats_with_its_seed(name: str) -> None:
    first, again, other = (SHAPES[name](rng(seed)) for seed in (3, 3, 4))
    assert np.isfinite(first.vertices).all()
    np.testing.assert_array_equal(first.triangles, again.triangles)
    assert not np.array_equal(first.bounds, other.bounds)
    points = sample_points(first, 60, rng())
    assert points.shape == (60, 3)
    assert np.ptp(points, axis=0).min() > 0.01


def test_points_are_spread_evenly_over_a_surface() -> None:
    # A box of 1 x 1 x 3: top and bottom have 2 of its 14 units of area.
    points = sample_points(box((1, 1, 3)), 20_000, rng())
    flat = (points[:, 2] < 1e-6) | (points[:, 2] > 3 - 1e-6)
    assert abs(flat.mean() - 2 / 14) < 0.01
    assert abs(points[~flat, 2].mean() - 1.5) < 0.03


def test_turned_bodies_lie_on_their_profile() -> None:
    points = sample_points(ellipsoid((1, 1)), 500, rng())
    assert np.abs(np.linalg.norm(points, axis=1) - 1).max() < 0.05
    ring = sample_points(torus(1, 0.25), 500, rng())
    tube = np.hypot(np.hypot(ring[:, 0], ring[:, 1]) - 1, ring[:, 2])
    assert np.abs(tube - 0.25).max() < 0.04


def test_a_surface_without_area_is_refused() -> None:
    with pytest.raises(DataError):
        sample_points(Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False), 5, rng())


def test_procedural_sets_are_the_same_for_a_seed_and_have_all_classes() -> None:
    config = ProceduralConfig(train=1, test=1, points=4)
    (train, test), (again, _) = (generate_shapes(config) for _ in range(2))
    np.testing.assert_array_equal(train.points, again.points)
    assert len(train) == len(test) == len(SHAPES) >= 20
    assert np.bincount(test.labels).tolist() == [1] * len(SHAPES)
    assert not np.array_equal(train.points, test.points)


def test_hdf5_files_of_modelnet40_are_read_and_stand_upright(tmp_path: Path) -> None:
    write_hdf5(tmp_path, [1, 0, 1])
    found = read_modelnet(tmp_path, "train", 20, rng())
    assert found.points.shape == (3, 20, 3) and found.points.dtype == np.float32
    assert found.names == ("airplane", "bathtub")
    assert found.labels.tolist() == [1, 0, 1]
    assert (found.points[:, :, 2] >= 0).all()


def test_hdf5_files_that_are_cut_short_or_too_small_are_named(tmp_path: Path) -> None:
    write_hdf5(tmp_path, [0, 1])
    with pytest.raises(DataError, match=r"ply_data_train0\.h5.*41"):
        read_modelnet(tmp_path, "train", 41, rng())
    file = tmp_path / "ply_data_train0.h5"
    file.write_bytes(file.read_bytes()[:300])
    with pytest.raises(DataError, match="ply_data_train0"):
        read_modelnet(tmp_path, "train", 20, rng())


# Hundreds of the published files have the counts on the line of the word OFF.
@rows("header", ["OFF\n", "OFF"])
def test_off_meshes_of_modelnet40_are_read(tmp_path: Path, header: str) -> None:
    write_off(tmp_path, "desk", "train", CUBE.format(header=header))
    write_off(tmp_path, "bed", "test", CUBE.format(header=header))
    found = read_modelnet(tmp_path, "train", 600, rng())
    assert found.names == ("bed", "desk") and found.labels.tolist() == [1]
    points = found.points[0]
    assert points.min() >= 0 and points.max() <= 1
    on_face = (np.isclose(points, 0, atol=1e-6) | np.isclose(points, 1, atol=1e-6)).any(axis=1)
    assert on_face.all()


def test_a_damaged_off_file_is_named(tmp_path: Path) -> None:
    path = write_off(tmp_path, "desk", "train", CUBE.format(header="OFF\n")[:60])
    with pytest.raises(DataError, match=path.name):
        read_modelnet(tmp_path, "train", 5, rng())


def test_a_folder_without_modelnet_says_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"train_files\.txt.*<class>/train"):
        read_modelnet(tmp_path, "train", 5, rng())


def test_voxels_lose_empty_and_repeated_grids(tmp_path: Path) -> None:
    grids = np.zeros((5, 1, 32, 32, 32))
    grids[1, 0, 4:9, 4:9, 4:9] = 1
    grids[2, 0, 1:3, 1:3, 1:30] = 1
    grids[4] = grids[1]
    path = tmp_path / "crate.npy.gz"
    with gzip.open(path, "wb") as stream:
        np.save(stream, grids)
    found = read_voxels(path, "crate", 300, rng())
    assert len(found) == 2 and found.names == ("crate",)
    # Inside the outer layer of voxels of the cube, but never in its middle.
    cube = found.points[0]
    assert cube.min() >= 4 and cube.max() <= 9
    assert not ((cube > 5) & (cube < 8)).all(axis=1).any()


@rows("values", [np.zeros((2, 1, 4, 4, 4)), np.zeros((3, 3)), b"no array"])
def test_other_voxel_files_are_named(tmp_path: Path, values: np.ndarray | bytes) -> None:
    path = tmp_path / "odd.npy"
    if isinstance(values, bytes):
        path.write_bytes(values)
    else:
        np.save(path, values)
    with pytest.raises(DataError, match=r"odd\.npy"):
        read_voxels(path, "odd", 5, rng())


def test_classes_of_the_same_name_are_one(tmp_path: Path) -> None:
    grids = np.zeros((6, 8, 8, 8))
    for number, grid in enumerate(grids):
        grid[: number + 2] = 1
    np.save(tmp_path / "chair.npy", grids)
    config = ProceduralConfig(train=1, test=1, points=4)
    train, test, words = load_shapes(config, voxels=[tmp_path / "chair.npy"])
    assert train.names == test.names == tuple(sorted(SHAPES))
    assert (train.labels == train.names.index("chair")).sum() == 1 + 4
    assert words == "procedural, voxels of chair.npy"


def test_sets_with_other_numbers_of_points_are_not_joined() -> None:
    points = [np.zeros((1, count, 3), np.float32) for count in (4, 5)]
    sets = [ShapeSet(each, np.zeros(1, np.int64), ("chair",)) for each in points]
    with pytest.raises(DataError, match=r"\[4, 5\]"):
        join_sets(sets)


def test_no_shapes_at_all_are_refused() -> None:
    with pytest.raises(ConfigError):
        load_shapes(ProceduralConfig(), procedural=False)


def test_the_unit_sphere_is_touched_and_a_single_point_becomes_zero() -> None:
    points = rng().normal(5, 3, (50, 3)).astype(np.float32)
    scaled = scale_to_sphere(points)
    assert np.linalg.norm(scaled, axis=1).max() == pytest.approx(1, abs=1e-6)
    assert np.abs(scaled.mean(axis=0)).max() < 1e-6
    np.testing.assert_array_equal(scale_to_sphere(points[:1]), np.zeros((1, 3)))


def test_networks_are_given_metres_over_a_range_or_a_unit_sphere() -> None:
    points = np.array([[1, 2, 3], [3, 2, 1]], np.float32)
    colors = np.array([[0, 255, 51], [255, 0, 0]], np.uint8)
    robot = network_input(points, colors, ROBOT)
    np.testing.assert_allclose(robot[0], [0.5, 1, 1.5, -1, 1, -0.6], atol=1e-6)
    assert network_input(points, None, PointNetConfig()).shape == (2, 3)


@rows(
    "points, colors, error, code",
    [
        (np.zeros((0, 3), np.float32), None, DataError, "no-points"),
        (np.zeros((4, 2), np.float32), None, ShapeError, "shape"),
        (np.array([[0, 0, 0], [0, np.nan, 0]], np.float32), None, DataError, "not-finite"),
        (np.zeros((4, 3), np.float32), None, DataError, "no-colors"),
        (np.zeros((4, 3), np.float32), np.zeros((3, 3), np.uint8), ShapeError, "shape"),
        (np.zeros((4, 3), np.float32), np.zeros((4, 3)), ShapeError, "shape"),
    ],
)
def test_bad_clouds_are_refused(points: np.ndarray, colors: Any, error: Any, code: str) -> None:
    with refuses(code, error=error):
        network_input(points, colors, ROBOT)


def test_turning_and_scaling_keep_up_as_it_is() -> None:
    points = rng().normal(size=(100, 3)).astype(np.float32)
    varied = augment(points, AugmentConfig(jitter=0, scale=0, dropout=0), rng(2))
    np.testing.assert_array_equal(varied[:, 2], points[:, 2])
    lengths = [np.linalg.norm(p[:, :2], axis=1) for p in (points, varied)]
    np.testing.assert_allclose(*lengths, rtol=1e-5)
    assert np.abs(varied - points).max() > 0.1


def test_jitter_is_cut_and_dropped_points_become_the_first() -> None:
    points = rng().normal(size=(2000, 3)).astype(np.float32)
    jittered = augment(points, AugmentConfig(turn=False, scale=0, dropout=0), rng(2))
    assert 0 < np.abs(jittered - points).max() <= 0.05 + 1e-6
    thinned = augment(points, AugmentConfig(turn=False, scale=0, jitter=0, dropout=0.9), rng(2))
    assert len(thinned) == len(points)
    assert 2 < (thinned == thinned[0]).all(axis=1).sum() < 1990


def test_resampling_takes_every_row_before_it_takes_one_again() -> None:
    rows = np.arange(10, dtype=np.float32)[:, None]
    assert len(np.unique(resample(rows, 7, rng()))) == 7
    more = resample(rows, 25, rng())
    assert len(more) == 25 and np.bincount(more[:, 0].astype(int)).min() == 2
