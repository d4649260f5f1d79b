# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Hulls of objects: volume, area and centre are right for solid, flat, straight and tiny ones."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull, Delaunay

from fusionslam.views import SceneConfig, build_scene
from rows import rows

ONE_CLUSTER = SceneConfig(preset="paper", eps=1e6, min_points=1, min_size=1)


def hull_of(points: ArrayLike) -> np.void:
    """The only object of a cloud that is one cluster."""
    cloud = np.asarray(points, np.float32)
    scene = build_scene(cloud, np.zeros(cloud.shape, np.uint8), config=ONE_CLUSTER)
    assert len(scene) == 1
    row: np.void = scene.objects[0]
    return row


def turn_points(points: ArrayLike, seed: int) -> NDArray[np.float64]:
    rotation = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return np.asarray(points, float) @ rotation.T


@rows("size, seeds", [(4, 8), (10, 8), (300, 4), (5000, 1)])
def test_solid_hulls_are_those_of_scipy(size: int, seeds: int) -> None:
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        scale = 10.0 ** rng.uniform(-2, 2)
        points = (scale * rng.normal(size=(size, 3)) * [1, 0.5, 0.2] + 3).astype(np.float32)
        ours, theirs = hull_of(points), ConvexHull(points.astype(float))
        assert ours["volume"] == pytest.approx(theirs.volume, rel=1e-9)
        assert ours["area"] == pytest.approx(theirs.area, rel=1e-9)
        outer = points[np.unique(theirs.simplices)].astype(float)
        corners = outer[Delaunay(outer).simplices]  # of tetrahedra
        volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
        centroid = volumes @ corners.mean(axis=1) / volumes.sum()
        np.testing.assert_allclose(ours["center"], centroid, atol=1e-6 * scale)
        np.testing.assert_array_equal(ours["box_min"], points.min(axis=0))
        np.testing.assert_array_equal(ours["box_max"], points.max(axis=0))


def test_a_box_with_points_on_its_faces_has_the_volume_and_area_of_the_box() -> None:
    lattice = np.stack(np.meshgrid(*[np.linspace(0, 1, 9)] * 3), axis=-1).reshape(-1, 3)
    box = hull_of(lattice * [2, 1, 0.5] + [5, 0, 0])
    assert box["volume"] == pytest.approx(1)
    assert box["area"] == pytest.approx(7)
    np.testing.assert_allclose(box["center"], [6, 0.5, 0.25])
    np.testing.assert_allclose(box["extents"], [2, 1, 0.5], rtol=1e-6)


@rows("seed", range(10))
@rows("offset", [0, 30])
def test_a_flat_object_has_no_volume_and_the_area_of_one_side(seed: int, offset: float) -> None:
    sheet = np.random.default_rng(seed).uniform(0, 1, (200, 3)) * [2, 1, 0]
    sheet[:4, :2] = [[0, 0], [2, 0], [0, 1], [2, 1]]
    flat = hull_of(turn_points(sheet, seed) + offset)
    assert flat["volume"] == 0
    assert flat["area"] == pytest.approx(2, rel=1e-4)
    np.testing.assert_allclose(flat["center"], turn_points([1, 0.5, 0], seed) + offset, atol=1e-4)


def test_a_flat_hull_is_that_of_scipy_in_the_plane() -> None:
    plane = np.random.default_rng(4).normal(size=(500, 2)).astype(np.float32)
    flat = hull_of(np.c_[plane, np.full(500, 1.5)])
    assert flat["area"] == pytest.approx(ConvexHull(plane.astype(float)).volume, rel=1e-9)
    assert flat["center"][2] == pytest.approx(1.5)


@rows("seed", range(5))
def test_a_straight_object_has_neither_volume_nor_area(seed: int) -> None:
    along = np.random.default_rng(seed).uniform(-1, 3, (50, 1))
    along[:2] = [[-1], [3]]
    line = hull_of(turn_points(along * [1, 0, 0], seed))
    assert (line["volume"], line["area"]) == (0, 0)
    np.testing.assert_allclose(line["center"], turn_points([1, 0, 0], seed), atol=1e-6)
    np.testing.assert_allclose(line["extents"], [4, 0, 0], atol=1e-6)


def test_few_or_equal_points_are_a_point_a_line_or_a_triangle() -> None:
    for size in (1, 2, 3, 50):
        point = hull_of(np.full((size, 3), [1, 2, 3]))
        assert (point["volume"], point["area"], point["points"]) == (0, 0, size)
        np.testing.assert_array_equal(point["center"], [1, 2, 3])
        np.testing.assert_array_equal(point["extents"], 0)
    np.testing.assert_allclose(hull_of([[0, 0, 0], [2, 2, 2]])["center"], 1)
    triangle = hull_of([[0, 0, 0], [3, 0, 0], [0, 3, 3]])
    assert (triangle["area"], triangle["volume"]) == (pytest.approx(np.sqrt(18) * 3 / 2), 0)
    np.testing.assert_allclose(triangle["center"], 1)


@rows("scale", [1e-30, 1e-3, 1, 1e5])
def test_tiny_and_huge_cubes_are_cubes(scale: float) -> None:
    corners = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    cube = hull_of(np.array(corners) * scale)
    assert cube["volume"] == pytest.approx(scale**3, rel=1e-5)
    assert cube["area"] == pytest.approx(6 * scale**2, rel=1e-5)


def test_nearly_flat_objects_pass_without_a_word(capfd: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(1)
    for exponent in np.arange(-12, 0, 0.5):
        sheet = rng.uniform(-1, 1, (80, 3)) * [1, 1, 10**exponent]
        flat = hull_of(turn_points(sheet, seed=2))
        assert 0 <= flat["volume"] <= 8 * 10**exponent + 1e-6
        assert 1 < flat["area"] < 10
    assert capfd.readouterr() == ("", "")


def test_threads_find_the_same_hulls_at_once() -> None:
    clouds = [np.random.default_rng(i).normal(size=(400, 3)).astype(np.float32) for i in range(8)]
    alone = [hull_of(cloud) for cloud in clouds]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(hull_of, clouds * 20)) == alone * 20
