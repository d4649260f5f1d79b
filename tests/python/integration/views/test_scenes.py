# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes: the objects of clouds under each preset, and what is made of bad clouds."""

import pickle

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

import fusionslam
from fusionslam import ConfigError, DataError, ShapeError
from fusionslam.views import Scene, SceneConfig, build_scene

Points = NDArray[np.float32]
Bytes = NDArray[np.uint8]
PRESETS = ("robust", "paper", "author")


def boxes(*sizes: int) -> tuple[Points, Bytes]:
    """Boxes 5 m apart above the floor, with so many points, in a row along x and shuffled."""
    rng = np.random.default_rng(0)
    places = np.repeat(np.arange(len(sizes)), sizes)
    points = rng.uniform(0, 1, (len(places), 3)) * [0.8, 0.5, 1] + [0, 0, 0.2]
    points += 5 * places[:, None] * [1, 0, 0]
    colors = rng.integers(0, 60, (len(places), 3)) + 60 * places[:, None]
    order = rng.permutation(len(places))
    return points[order].astype(np.float32), colors[order].astype(np.uint8)


def test_objects_are_described_by_their_points() -> None:
    points, colors = boxes(300)
    for preset in PRESETS:
        row = build_scene(points, colors, preset=preset).objects[0]
        assert row["points"] == 300
        assert row["volume"] == pytest.approx(ConvexHull(points.astype(float)).volume)
        np.testing.assert_array_equal(row["box_min"], points.min(axis=0))
        np.testing.assert_array_equal(row["box_max"], points.max(axis=0))
        middle = (points.min(axis=0).astype(float) + points.max(axis=0)) / 2
        if preset == "author":
            np.testing.assert_array_equal(row["center"], middle)
            np.testing.assert_array_equal(row["color"], np.median(colors, axis=0).astype(int))
        else:
            np.testing.assert_allclose(row["center"], middle, atol=0.05)
            np.testing.assert_allclose(row["color"], colors.mean(axis=0), rtol=1e-12)


def test_extents_are_those_along_the_object_s_own_axes() -> None:
    points, colors = boxes(4000)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0].astype(np.float32)
    row = build_scene(points @ turn, colors, config=SceneConfig(floor=0)).objects[0]
    np.testing.assert_allclose(row["extents"], [1, 0.8, 0.5], rtol=0.1)


def test_the_median_of_an_even_number_of_points_is_truncated() -> None:
    points = np.zeros((4, 3), np.float32)
    colors = np.array([[0, 10, 255], [1, 10, 255], [2, 13, 0], [3, 255, 255]], np.uint8)
    config = SceneConfig(preset="author", min_points=1)
    scene = build_scene(points, colors, config=config)
    assert scene.objects["color"].tolist() == [[1, 11, 255]]


def test_objects_with_most_points_come_first_and_then_the_first_in_the_cloud() -> None:
    points, colors = boxes(60, 200, 60, 90)
    assert build_scene(points, colors).objects["points"].tolist() == [200, 90, 60, 60]
    order = np.argsort(points[:, 0], kind="stable")
    for turned, expected in ((order, [0, 10]), (order[::-1], [10, 0])):
        objects = build_scene(points[turned], colors[turned]).objects
        assert (objects["center"][2:, 0] // 5 * 5).tolist() == expected


def test_clusters_below_the_smallest_size_are_no_objects() -> None:
    points, colors = boxes(60, 200, 99, 100)
    config = SceneConfig(min_size=100)
    assert build_scene(points, colors, config=config).objects["points"].tolist() == [200, 100]
    assert SceneConfig(preset="author").min_size == 1


def test_touching_objects_of_different_colors_are_told_apart_by_the_robust_preset_only() -> None:
    points = np.random.default_rng(0).uniform(0.2, 1.2, (1500, 3)).astype(np.float32)
    colors = np.where(points[:, :1] < 0.7, [[250, 60, 10]], [[10, 60, 250]]).astype(np.uint8)
    counts = {preset: len(build_scene(points, colors, preset=preset)) for preset in PRESETS}
    assert counts == {"robust": 2, "paper": 1, "author": 1}


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("size", [0, 1, 9])
def test_clouds_without_clusters_give_empty_scenes(preset: str, size: int) -> None:
    points = np.arange(3 * size, dtype=np.float32).reshape(size, 3) * 10
    scene = build_scene(points, np.zeros((size, 3), np.uint8), preset=preset)
    assert len(scene) == 0
    assert scene.objects.shape == (0,)


def test_one_point_is_an_object_if_one_point_may_be_a_cluster() -> None:
    config = SceneConfig(min_points=1, min_size=1)
    scene = build_scene(np.ones((1, 3), np.float32), np.full((1, 3), 9, np.uint8), config=config)
    assert scene.objects[0]["points"] == 1
    assert scene.objects[0]["color"].tolist() == [9, 9, 9]


def test_a_million_points_in_one_cluster_are_one_object() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(1, 2, (1_000_000, 3)).astype(np.float32)
    scene = build_scene(points, np.zeros(points.shape, np.uint8))
    assert scene.objects["points"].tolist() == [1_000_000]
    assert scene.objects["volume"][0] == pytest.approx(1, rel=1e-2)


def test_clouds_without_colors_are_refused() -> None:
    with pytest.raises(DataError):
        build_scene(np.zeros((5, 3), np.float32), None)


def test_bad_clouds_and_options_are_refused() -> None:
    points, colors = boxes(50)
    with pytest.raises(ShapeError, match=r"colors .*49.*points .*50"):
        build_scene(points, colors[1:])
    with pytest.raises(ConfigError, match=r"preset .*best"):
        build_scene(points, colors, preset="best")
    with pytest.raises(ConfigError, match=r"scene\.eps"):
        SceneConfig(eps=0)
    with pytest.raises(ConfigError, match="radius"):
        SceneConfig(radius=1)
    points[7] = [np.nan, 1, 0]  # of the floor
    for preset in PRESETS:
        with pytest.raises(DataError, match=r"\b7\b"):
            build_scene(points, colors, preset=preset)


def test_scenes_are_values() -> None:
    points, colors = boxes(80, 60)
    scene = build_scene(points, colors)
    assert scene == build_scene(points, colors) == Scene(scene.objects, scene.image)
    assert hash(scene) == hash(Scene(scene.objects, scene.image))
    assert scene != Scene(scene.objects[:1], scene.image)
    assert scene != Scene(scene.objects[::-1], scene.image)
    assert scene != Scene(scene.objects)
    assert scene != "scene"
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert repr(scene) == "<Scene of 2 objects>"
    with pytest.raises(ValueError, match="read-only"):
        scene.objects["points"] = 3


def test_objects_outlive_their_scene() -> None:
    points, colors = boxes(80)
    objects = build_scene(points, colors).objects
    assert objects["points"].tolist() == [80]


def test_scenes_of_impossible_objects_are_refused() -> None:
    objects = build_scene(*boxes(80)).objects.copy()
    with pytest.raises(ShapeError, match=r"Scene\.objects"):
        Scene(np.zeros((2, 3)))
    objects["volume"] = np.nan
    with pytest.raises(DataError, match=r"object 0.*volume"):
        Scene(objects)
    objects["volume"], objects["points"] = 1, 0
    with pytest.raises(DataError, match=r"object 0.*points"):
        Scene(objects)


def test_the_package_offers_views() -> None:
    assert fusionslam.views.build_scene is build_scene
    assert "views" in dir(fusionslam)
