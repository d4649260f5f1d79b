# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ground, voxels and invalid points against NumPy."""

import numpy as np
import pytest
from numpy.typing import NDArray

import fusionslam
from clouds import ground_and_things, scene
from fusionslam import ConfigError, DataError
from rows import rows

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


def test_a_wall_is_no_ground() -> None:
    rng = np.random.default_rng(12)
    wall = rng.uniform([-20, -0.01, -2], [20, 0.01, 6], (2000, 3)).astype(np.float32)
    config = fusionslam.GroundPlaneConfig(distance=0.001, max_tilt=5)
    kept, plane = fusionslam.remove_ground_plane(wall, config=config)
    assert len(kept) > 1900
    assert not plane.any() or plane[2] > np.cos(np.radians(5)) - 1e-6


def test_ground_removal_refuses_what_it_cannot_do() -> None:
    points = ground_and_things(13)[0].astype(np.float32)
    with pytest.raises(ConfigError, match=r"'w'.* x, y, z, -x, -y, -z"):
        fusionslam.above_height(points, 0.0, up="w")
    with pytest.raises(ConfigError, match="height"):
        fusionslam.above_height(points, float("nan"))
    with pytest.raises(DataError, match="2 points"):
        fusionslam.remove_ground_plane(points[:2])


def test_points_without_any_plane_are_all_kept_and_nothing_is_printed(
    capfd: pytest.CaptureFixture[str],
) -> None:
    same = np.ones((10, 3), np.float32)
    kept, plane = fusionslam.remove_ground_plane(same)
    assert len(kept) == 10 and not plane.any()
    assert capfd.readouterr() == ("", "")


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


@rows("size", [0.0, -1.0, float("nan")])
def test_a_voxel_size_must_be_positive(size: float) -> None:
    with pytest.raises(ConfigError, match="voxel"):
        fusionslam.voxel_downsample(scene(15)[0], size=size)


def test_voxels_far_too_small_are_refused() -> None:
    with pytest.raises(DataError, match="voxels"):
        fusionslam.voxel_downsample(scene(16)[0], size=1e-9)


def test_invalid_points_are_dropped_and_the_rest_keep_their_order() -> None:
    points, _ = scene(17)
    points[[3, 700], 0], points[[3, 41], 2] = np.nan, -np.inf
    kept = fusionslam.drop_invalid(points)
    assert np.array_equal(kept, np.delete(np.arange(len(points)), [3, 41, 700]))
