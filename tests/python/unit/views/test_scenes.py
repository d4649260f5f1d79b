# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes: objects of clouds under each preset, range images, and what is made of bad clouds."""

import math
import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

import fusionslam
from fusionslam import ConfigError, DataError, ShapeError
from fusionslam.sensors.frame import Cloud
from fusionslam.views import RangeImage, Scene, SceneConfig, build_scene
from rows import rows
from worlds import AROUND, room, scan

Points = NDArray[np.float32]
Bytes = NDArray[np.uint8]
PRESETS = ("robust", "paper", "author")
POSE = (0.4, -0.2, 0.9)


def boxes(*sizes: int) -> tuple[Points, Bytes]:
    """Boxes 5 m apart above the floor, with so many points, in a row along x and shuffled."""
    rng = np.random.default_rng(0)
    places = np.repeat(np.arange(len(sizes)), sizes)
    points = rng.uniform(0, 1, (len(places), 3)) * [0.8, 0.5, 1] + [0, 0, 0.2]
    points += 5 * places[:, None] * [1, 0, 0]
    colors = rng.integers(0, 60, (len(places), 3)) + 60 * places[:, None]
    order = rng.permutation(len(places))
    return points[order].astype(np.float32), colors[order].astype(np.uint8)


@rows("preset", PRESETS)
def test_objects_are_described_by_their_points(preset: str) -> None:
    points, colors = boxes(300)
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
    colors = np.array([[0, 10, 255], [1, 10, 255], [2, 13, 0], [3, 255, 255]], np.uint8)
    config = SceneConfig(preset="author", min_points=1)
    scene = build_scene(np.zeros((4, 3), np.float32), colors, config=config)
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


@rows("size", [0, 1, 9])
def test_clouds_without_clusters_give_empty_scenes(size: int) -> None:
    points = np.arange(3 * size, dtype=np.float32).reshape(size, 3) * 10
    for preset in PRESETS:
        scene = build_scene(points, np.zeros((size, 3), np.uint8), preset=preset)
        assert len(scene) == 0 and scene.objects.shape == (0,)


def test_one_point_is_an_object_if_one_point_may_be_a_cluster() -> None:
    config = SceneConfig(min_points=1, min_size=1)
    scene = build_scene(np.ones((1, 3), np.float32), np.full((1, 3), 9, np.uint8), config=config)
    assert scene.objects["points"].tolist() == [1]
    assert scene.objects["color"].tolist() == [[9, 9, 9]]


@pytest.mark.nightly
def test_a_million_points_in_one_cluster_are_one_object() -> None:
    points = np.random.default_rng(0).uniform(1, 2, (1_000_000, 3)).astype(np.float32)
    scene = build_scene(points, np.zeros(points.shape, np.uint8))
    assert scene.objects["points"].tolist() == [1_000_000]
    assert scene.objects["volume"][0] == pytest.approx(1, rel=1e-2)


def test_bad_clouds_are_refused() -> None:
    points, colors = boxes(50)
    with pytest.raises(DataError):
        build_scene(points, None)
    with pytest.raises(ShapeError, match=r"colors .*49.*points .*50"):
        build_scene(points, colors[1:])
    with pytest.raises(ConfigError, match=r"preset .*best"):
        build_scene(points, colors, preset="best")
    points[7] = [np.nan, 1, 0]  # of the floor
    for preset in PRESETS:
        with pytest.raises(DataError, match=r"\b7\b"):
            build_scene(points, colors, preset=preset)


@rows(
    "values, words",
    [
        ({"eps": 0}, r"scene\.eps"),
        ({"radius": 1}, "radius"),
        ({"azimuth_step": 0.0}, "azimuth_step"),
        ({"elevation_step": 90.0}, "elevation_step"),
        ({"longest_range": 1000.0}, "longest_range"),
        ({"sensor_z": float("nan")}, "sensor_z"),
        ({"floor": -1.0}, "floor"),
    ],
)
def test_bad_configurations_are_refused_by_name(values: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        SceneConfig(**values)


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


def test_objects_outlive_their_scene_and_the_package_offers_views() -> None:
    assert fusionslam.views.build_scene(*boxes(80)).objects["points"].tolist() == [80]
    assert "views" in dir(fusionslam)


def test_scenes_of_impossible_objects_are_refused() -> None:
    with pytest.raises(ShapeError, match=r"Scene\.objects"):
        Scene(np.zeros((2, 3)))
    for field, value in (("volume", np.nan), ("points", 0)):
        objects = build_scene(*boxes(80)).objects.copy()
        objects[field] = value
        with pytest.raises(DataError, match=rf"object 0.*{field}"):
            Scene(objects)


def scene_of(cloud: Cloud, **values: Any) -> Scene:
    return build_scene(cloud.points, cloud.colors, config=SceneConfig(**values))


def nearest_half_up(value: float) -> int:
    return int(np.sign(value) * np.floor(abs(value) + 0.5))


def plain_image(cloud: Cloud, azimuth_step: float, elevation_step: float) -> NDArray[Any]:
    """Project as docs/stages/views/alignment.md says: rows of column, row, range, colour."""
    assert cloud.colors is not None
    cells: dict[tuple[int, int], list[tuple[float, Bytes]]] = {}
    for point, color in zip(cloud.points.astype(np.float64), cloud.colors, strict=True):
        x, y, z = point - [0, 0, 0.17]
        far = math.hypot(x, y, z)
        if abs(point[2]) <= 0.1 or not 0.01 <= far <= 30:
            continue
        row = math.degrees(math.atan2(z, math.hypot(x, y))) / elevation_step
        column = math.degrees(math.atan2(y, x)) / azimuth_step
        place = (nearest_half_up(row), nearest_half_up(column))
        cells.setdefault(place, []).append((far, color))
    rows_of_cells = []
    for (row, column), found in sorted(cells.items()):
        nearest = min(far for far, _ in found)
        surface = [(far, color) for far, color in found if far <= 1.05 * nearest + 0.1]
        centimetres = 100 * np.mean([far for far, _ in surface])
        color = np.mean([color for _, color in surface], axis=0).astype(int) // 8 * 8
        rows_of_cells.append([column, row, nearest_half_up(float(centimetres)), *color])
    return np.array(rows_of_cells)


@rows("steps", [(1.0, 2.0), (3.0, 5.0), (0.5, 0.5)])
def test_a_range_image_is_what_a_plain_loop_makes(steps: tuple[float, float]) -> None:
    rng = np.random.default_rng(1)
    cloud = scan(room(0), POSE, AROUND[::15])
    noise = rng.normal(0, 3, (300, 3)).astype(np.float32)  # several surfaces in a cell, far floor
    colors = np.concatenate([cloud.colors, rng.integers(0, 256, (300, 3), np.uint8)])
    cloud = Cloud(np.concatenate([cloud.points, noise]), colors)
    cells = scene_of(cloud, azimuth_step=steps[0], elevation_step=steps[1]).image.cells
    expected = plain_image(cloud, *steps)
    assert len(cells) == len(expected) > 300
    assert cells["column"].tolist() == expected[:, 0].tolist()
    assert cells["row"].tolist() == expected[:, 1].tolist()
    apart = np.abs(cells["range"].astype(int) - expected[:, 2])
    assert apart.max() <= 1 and (apart == 0).mean() > 0.99  # points are floats here, doubles there
    assert np.array_equal(cells["color"], expected[:, 3:])


def test_points_outside_the_sensors_range_are_left_out() -> None:
    far = np.array([[31, 0, 0.3], [5, 0, 0.3], [0, 0, 0.17]], np.float32)
    cloud = Cloud(far, np.full((3, 3), 100, np.uint8))
    image = scene_of(cloud).image
    assert image.cells["range"].tolist() == [500] and image.cells["color"].tolist() == [[96] * 3]
    assert len(scene_of(cloud, longest_range=40.0).image) == 2
    aside = scene_of(cloud, sensor_x=2.0, sensor_y=0.0, sensor_z=0.3).image
    assert aside.cells["range"].tolist()[-1] == 300 and aside.sensor == pytest.approx([2, 0, 0.3])


def test_the_floor_makes_no_difference_to_the_robust_preset() -> None:
    cloud = scan(room(1), POSE)
    assert cloud.colors is not None
    floor = np.random.default_rng(0).uniform([-3, -3, -0.0999], [3, 3, 0.0999], (4000, 3))
    points = np.concatenate([floor.astype(np.float32), cloud.points])
    both = Cloud(points, np.concatenate([np.full((4000, 3), 90, np.uint8), cloud.colors]))
    assert scene_of(both) == scene_of(cloud) != scene_of(both, floor=0)
    assert all(len(scene_of(both, preset=name).image) == 0 for name in ("paper", "author"))


def test_range_images_are_values() -> None:
    image = scene_of(scan(room(2), POSE)).image
    steps = (image.azimuth_step, image.elevation_step, image.sensor)
    assert RangeImage(image.cells, *steps) == image != RangeImage(image.cells[:-1], *steps)
    assert image != "image" and len(image) == len(image.cells)
    with pytest.raises(ValueError, match="read-only"):
        image.cells["range"] = 3
    with pytest.raises(ShapeError, match=r"RangeImage\.cells"):
        RangeImage(np.zeros((3, 6)), 1.0, 2.0, [0, 0, 0])
