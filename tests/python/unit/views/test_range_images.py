# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Range images: against a plain loop, and as bytes and JSON, whole and damaged."""

import json
import pickle
import struct
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fusionslam import ConfigError, DataError, ShapeError
from fusionslam.sensors.frame import Cloud
from fusionslam.views import RangeImage, Scene, SceneConfig, build_scene
from worlds import AROUND, room, scan

POSE = (0.4, -0.2, 0.9)


def scene_of(cloud: Cloud, **values: Any) -> Scene:
    return build_scene(cloud.points, cloud.colors, config=SceneConfig(**values))


def nearest_half_up(value: float) -> int:
    return int(np.sign(value) * np.floor(abs(value) + 0.5))


def plain_image(cloud: Cloud, azimuth_step: float, elevation_step: float) -> NDArray[Any]:
    """Project as docs/stages/views/alignment.md says: rows of column, row, range, colour."""
    assert cloud.colors is not None
    cells: dict[tuple[int, int], list[tuple[float, NDArray[np.uint8]]]] = {}
    for point, color in zip(cloud.points.astype(np.float64), cloud.colors, strict=True):
        x, y, z = point - [0, 0, 0.17]
        if abs(point[2]) <= 0.1 or not 0.01 <= np.linalg.norm([x, y, z]) <= 30:
            continue
        row = np.degrees(np.arctan2(z, np.hypot(x, y))) / elevation_step
        column = np.degrees(np.arctan2(y, x)) / azimuth_step
        place = (nearest_half_up(row), nearest_half_up(column))
        cells.setdefault(place, []).append((float(np.linalg.norm([x, y, z])), color))
    rows = []
    for (row, column), found in sorted(cells.items()):
        nearest = min(far for far, _ in found)
        surface = [(far, color) for far, color in found if far <= 1.05 * nearest + 0.1]
        centimetres = 100 * np.mean([far for far, _ in surface])
        color = np.mean([color for _, color in surface], axis=0).astype(int) // 8 * 8
        rows.append([column, row, nearest_half_up(float(centimetres)), *color])
    return np.array(rows)


@pytest.mark.parametrize("steps", [(1.0, 2.0), (3.0, 5.0), (0.5, 0.5)])
def test_a_range_image_is_what_a_plain_loop_makes(steps: tuple[float, float]) -> None:
    rng = np.random.default_rng(1)
    cloud = scan(room(0), POSE, AROUND)
    noise = rng.normal(0, 3, (2000, 3)).astype(np.float32)  # several surfaces in a cell, far floor
    colors = np.concatenate([cloud.colors, rng.integers(0, 256, (2000, 3), np.uint8)])
    cloud = Cloud(np.concatenate([cloud.points, noise]), colors)
    image = scene_of(cloud, azimuth_step=steps[0], elevation_step=steps[1]).image
    expected = plain_image(cloud, *steps)
    assert len(image) == len(expected) > 1000
    assert image.cells["column"].tolist() == expected[:, 0].tolist()
    assert image.cells["row"].tolist() == expected[:, 1].tolist()
    apart = np.abs(image.cells["range"].astype(int) - expected[:, 2])
    assert apart.max() <= 1 and (apart == 0).mean() > 0.99  # points are floats here, doubles there
    assert np.array_equal(image.cells["color"], expected[:, 3:])


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
    floor = np.random.default_rng(0).uniform(-3, 3, (4000, 3))
    floor[:, 2] = np.random.default_rng(1).uniform(-0.0999, 0.0999, 4000)
    points = np.concatenate([floor.astype(np.float32), cloud.points])
    both = Cloud(points, np.concatenate([np.full((4000, 3), 90, np.uint8), cloud.colors]))
    assert scene_of(both) == scene_of(cloud) != scene_of(both, floor=0)
    assert all(len(scene_of(both, preset=name).image) == 0 for name in ("paper", "author"))


def test_bytes_and_json_bring_the_image_back_exactly() -> None:
    scene = scene_of(scan(room(2), POSE, AROUND))
    assert len(scene.image) > 4000 and len(scene)
    data = scene.to_bytes()
    back = Scene.from_bytes(data)
    assert back.image == scene.image and hash(back.image) == hash(scene.image)
    assert back.to_bytes() == data and len(data) < 2.5 * len(scene.image)
    assert len(scene.to_bytes(image=False)) < 200
    assert Scene.from_bytes(scene.to_bytes(image=False)).image == scene_of(NOTHING).image
    assert Scene.from_json(scene.to_json()) == scene == pickle.loads(pickle.dumps(scene))


NOTHING = Cloud(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8))


def test_images_are_values() -> None:
    image = scene_of(scan(room(2), POSE)).image
    steps = (image.azimuth_step, image.elevation_step, image.sensor)
    assert RangeImage(image.cells, *steps) == image != RangeImage(image.cells[:-1], *steps)
    assert image != "image" and len(image) == len(image.cells)
    with pytest.raises(ValueError, match="read-only"):
        image.cells["range"] = 3


def test_cut_or_damaged_bytes_are_refused() -> None:
    scene = scene_of(scan(room(2), POSE), azimuth_step=4.0, elevation_step=6.0)
    data = scene.to_bytes()
    for length in range(len(data)):
        with pytest.raises(DataError):
            Scene.from_bytes(data[:length])
    for bit in range(8 * len(data)):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DataError):
            Scene.from_bytes(bytes(damaged))


def crc(data: bytes) -> bytes:
    """CRC-16/CCITT by its polynomial."""
    value = 0xFFFF
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
    return value.to_bytes(2, "little")


def test_damage_with_a_right_checksum_gives_an_image_or_an_error() -> None:
    scene = scene_of(scan(room(2), POSE), azimuth_step=4.0, elevation_step=6.0)
    data = scene.to_bytes(), scene_of(NOTHING).to_bytes()
    rng, read, refused = np.random.default_rng(3), 0, 0
    for _ in range(3000):
        damaged = bytearray(data[0][:-2])
        for place in rng.integers(2, len(damaged), rng.integers(1, 4)):
            damaged[place] = rng.integers(256)
        try:
            image = Scene.from_bytes(bytes(damaged) + crc(bytes(damaged))).image
            read += len(image) <= 8 * len(damaged)
        except DataError:
            refused += 1
    assert read + refused == 3000 and min(read, refused) > 100


@pytest.mark.parametrize("step", [0.0, -1.0, 1e-30, 0.05, 31.0, np.inf, np.nan])
def test_impossible_steps_are_refused(step: float) -> None:
    scene = scene_of(scan(room(2), POSE), azimuth_step=3.0)
    data = scene.to_bytes()
    orders = [order for order in "<>" if struct.pack(f"{order}f", 3.0) in data]
    assert orders
    body = data[:-2].replace(struct.pack(f"{orders[0]}f", 3.0), struct.pack(f"{orders[0]}f", step))
    with pytest.raises(DataError):
        Scene.from_bytes(body + crc(body))
    with pytest.raises(DataError):
        RangeImage(scene.image.cells, step, 2.0, [0, 0, 0])


@pytest.mark.parametrize(
    "image",
    [
        3,
        {},
        {"cells": 5},
        {"cells": [[1, 2]]},
        {"sensor": [0, 0]},
        {"azimuth_step": "wide"},
        {"azimuth_step": 1e-9},
        {"cells": [[0, 0, 100, 8, 8, 8], [0, 0, 100, 8, 8, 8]]},
        {"cells": [[400, 0, 100, 8, 8, 8]]},
        {"cells": [[0, 0, 100, 7, 8, 8]]},
        {"cells": [[0, 0, 70000, 8, 8, 8]]},
    ],
)
def test_json_of_no_image_is_refused(image: Any) -> None:
    whole = json.loads(scene_of(scan(room(2), POSE)).to_json())
    whole["image"] = {**whole["image"], **image} if isinstance(image, dict) and image else image
    with pytest.raises(DataError):
        Scene.from_json(json.dumps(whole))


def test_arrays_that_are_no_cells_are_refused() -> None:
    with pytest.raises(ShapeError, match=r"RangeImage\.cells"):
        RangeImage(np.zeros((3, 6)), 1.0, 2.0, [0, 0, 0])


@pytest.mark.parametrize(
    "values",
    [
        {"azimuth_step": 0.0},
        {"elevation_step": 90.0},
        {"longest_range": 1000.0},
        {"sensor_z": float("nan")},
        {"floor": -1.0},
    ],
)
def test_bad_configurations_are_refused_by_name(values: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(values))):
        SceneConfig(**values)
