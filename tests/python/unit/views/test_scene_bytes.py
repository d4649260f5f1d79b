# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes as bytes and as JSON: small, true to the scene, and suspicious of everything else."""

import binascii
import json
import pickle
import resource
import struct
from functools import cache
from typing import Any

import numpy as np
import pytest

from fusionslam import DataError
from fusionslam.views import RangeImage, Scene, SceneConfig, build_scene
from rows import rows
from scenes import EMPTY_SCENE, random_scene
from worlds import room, scan

# How far a number may be from what was stored: half a step.
HALF_STEPS = {"center": 5e-5, "volume": 1e-5, "area": 1e-4, "color": 2**-11, "extents": 5e-5}


@cache
def scene_with_image(**values: Any) -> Scene:
    cloud = scan(room(2), (0.4, -0.2, 0.9))
    return build_scene(cloud.points, cloud.colors, config=SceneConfig(**values))


def coarse_scene() -> Scene:
    return scene_with_image(azimuth_step=4.0, elevation_step=6.0)


@rows("size", [0, 1, 5, 300])
def test_bytes_bring_back_the_scene_to_half_a_step(size: int) -> None:
    scene = random_scene(size, size)
    back = Scene.from_bytes(scene.to_bytes())
    assert len(back) == size
    np.testing.assert_array_equal(back.objects["points"], scene.objects["points"])
    for name, half in HALF_STEPS.items():
        error = np.abs(back.objects[name] - scene.objects[name]).max(initial=0)
        assert error <= half * (1 + 1e-6)
        assert size < 300 or error > half / 2  # no bits are wasted
    for name in ("box_min", "box_max"):  # boxes are not stored
        np.testing.assert_array_equal(back.objects[name], back.objects["center"])


@rows("scene", [random_scene(3, 20), scene_with_image()])
def test_a_scene_from_bytes_gives_the_same_bytes(scene: Scene) -> None:
    data = scene.to_bytes()
    back = Scene.from_bytes(data)
    assert back.to_bytes() == data
    assert back.image == scene.image and hash(back.image) == hash(scene.image)


def test_a_view_takes_about_a_hundred_bytes() -> None:
    assert len(EMPTY_SCENE.to_bytes()) == 7
    for count, most in ((1, 40), (3, 100), (100, 100 * 29)):
        assert len(random_scene(0, count).to_bytes()) <= most


def test_an_image_takes_two_and_a_half_bytes_a_cell_and_can_be_left_out() -> None:
    scene = scene_with_image()
    assert len(scene.image) > 1000 and len(scene)
    assert len(scene.to_bytes()) < 2.5 * len(scene.image)
    assert len(scene.to_bytes(image=False)) < 200
    assert Scene.from_bytes(scene.to_bytes(image=False)).image == EMPTY_SCENE.image


def test_flat_small_and_distant_objects_are_stored() -> None:
    objects = random_scene(1, 3).objects.copy()
    objects["volume"][0], objects["area"][1], objects["center"][2] = 0, 0, [-3e6, 3e6, 0]
    objects["points"][2] = 2**40
    back = Scene.from_bytes(Scene(objects).to_bytes()).objects
    assert (back["volume"][0], back["area"][1], back["points"][2]) == (0, 0, 2**40)
    np.testing.assert_allclose(back["center"][2], [-3e6, 3e6, 0], atol=1e-4)


@rows("field, value, words", [("center", 1e30, r"center .*1e\+30"), ("volume", -1, r"volume .*-1")])
def test_values_that_cannot_be_stored_are_refused(field: str, value: float, words: str) -> None:
    objects = random_scene(1, 1).objects.copy()
    objects[field] = value
    with pytest.raises(DataError, match=words):
        Scene(objects).to_bytes()


def flip(data: bytes, bit: int) -> bytes:
    damaged = bytearray(data)
    damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


@rows("scene", [EMPTY_SCENE, random_scene(2, 1), random_scene(2, 4), coarse_scene()])
def test_cut_longer_and_damaged_bytes_are_refused(scene: Scene) -> None:
    data = scene.to_bytes()
    cut = [data[:length] for length in range(len(data))]
    damaged = [flip(data, bit) for bit in range(8 * len(data))]
    for other in (*cut, data + b"\0", *damaged):
        with pytest.raises(DataError):
            Scene.from_bytes(other)


def test_bytes_of_another_version_say_so() -> None:
    data = bytearray(random_scene(2, 4).to_bytes())
    data[1] = 9
    with pytest.raises(DataError, match=r"9.*1"):
        Scene.from_bytes(bytes(data))


def test_foreign_bytes_are_refused() -> None:
    rng = np.random.default_rng(0)
    for foreign in (b"\x89PNG", *(rng.bytes(length) for length in range(200))):
        with pytest.raises(DataError):
            Scene.from_bytes(foreign)


def with_checksum(data: bytes) -> bytes:
    """CRC-16/CCITT."""
    return data + binascii.crc_hqx(data, 0xFFFF).to_bytes(2, "little")


def test_sections_of_later_programs_are_passed_over() -> None:
    data = random_scene(2, 4).to_bytes()
    longer = with_checksum(data[:-2] + bytes([77, 3]) + b"new")
    assert Scene.from_bytes(longer) == Scene.from_bytes(data)


@rows(
    "content", [b"\1\xff", b"\1\5\4", b"\1\1\xff", b"\1\7\xff\xff\xff\xff\xff\xff\7", b"\xff" * 20]
)
def test_nonsense_with_a_right_checksum_is_refused(content: bytes) -> None:
    with pytest.raises(DataError):
        Scene.from_bytes(with_checksum(b"\x5c\1" + content))


def test_damage_with_a_right_checksum_gives_an_image_or_an_error() -> None:
    data = coarse_scene().to_bytes()[:-2]
    rng, read, refused = np.random.default_rng(3), 0, 0
    for _ in range(600):
        damaged = bytearray(data)
        for place in rng.integers(2, len(damaged), rng.integers(1, 4)):
            damaged[place] = rng.integers(256)
        try:
            image = Scene.from_bytes(with_checksum(bytes(damaged))).image
            read += len(image) <= 8 * len(damaged)
        except DataError:
            refused += 1
    assert read + refused == 600 and min(read, refused) > 20


@rows("step", [0.0, -1.0, 1e-30, 0.05, 31.0, np.inf, np.nan])
def test_impossible_steps_are_refused(step: float) -> None:
    scene = scene_with_image(azimuth_step=3.0)
    data = scene.to_bytes()
    order = next(order for order in "<>" if struct.pack(f"{order}f", 3.0) in data)
    changed = data[:-2].replace(struct.pack(f"{order}f", 3.0), struct.pack(f"{order}f", step))
    with pytest.raises(DataError):
        Scene.from_bytes(with_checksum(changed))
    with pytest.raises(DataError):
        RangeImage(scene.image.cells, step, 2.0, [0, 0, 0])


def varint(value: int) -> bytes:
    return bytes([value]) if value < 128 else bytes([value & 127 | 128]) + varint(value >> 7)


def small(value: int, order: int) -> str:
    """An exponential Golomb code."""
    high = (value >> order) + 1
    width = high.bit_length() - 1
    return "0" * width + "1" + plain(high - (1 << width), width) + plain(value, order)


def plain(value: int, width: int) -> str:
    return "".join(str(value >> i & 1) for i in range(width))


def scene_bytes(kind: int, bits: str) -> bytes:
    """A scene of one section, of bits of which the first are the lowest."""
    padded = bits + "0" * (-len(bits) % 8)
    content = int(padded[::-1], 2).to_bytes(len(padded) // 8, "little")
    return with_checksum(b"\x5c\1" + varint(kind) + varint(len(content)) + content)


def image_bits(rows: int, columns: int, runs: list[int]) -> str:
    steps = plain(int(np.float32(0.1).view(np.uint32)), 32) * 2
    box = small(0, 4) + small(0, 6) + small(rows, 4) + small(columns, 6)
    return steps + plain(0, 96) + box + "".join(small(run, 2) for run in runs)


def object_bits(count: int, points: str) -> str:
    named = "".join(plain(byte, 8) for byte in varint(count))
    return named + plain(1, 6) + points + plain(0, 30)


def test_bytes_that_name_more_cells_than_they_hold_take_no_memory() -> None:
    bomb = scene_bytes(2, image_bits(7200, 7200, [0, 7200 * 7200]))
    assert len(bomb) < 50
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DataError):
        Scene.from_bytes(bomb)
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert after - before < 50_000  # kB; all cells would take 500 MB


def test_a_cell_of_the_fewest_bits_is_read() -> None:
    cells = image_bits(1, 3, [0, 3]) + (small(0, 3) + 3 * small(0, 1)) * 3
    assert len(Scene.from_bytes(scene_bytes(2, cells)).image) == 3


def test_bytes_of_more_than_a_million_objects_are_refused() -> None:
    with pytest.raises(DataError):
        Scene.from_bytes(scene_bytes(1, object_bits(8_000_000, "1" * 8_000_000)))


def test_objects_without_points_are_refused() -> None:
    assert len(Scene.from_bytes(scene_bytes(1, object_bits(1, "1")))) == 1
    with pytest.raises(DataError):
        Scene.from_bytes(scene_bytes(1, object_bits(1, "0")))


def test_json_is_exact_and_readable() -> None:
    scene = random_scene(4, 3)
    text = scene.to_json()
    entries = json.loads(text)["objects"]
    assert entries[1]["center"] == scene.objects["center"][1].tolist()
    assert len(text.splitlines()) == 5
    for each in (scene, EMPTY_SCENE, scene_with_image()):
        assert Scene.from_json(each.to_json()) == each == pickle.loads(pickle.dumps(each))


@rows(
    "text, message",
    [
        ("", "JSON"),
        ("[1]", "version and objects"),
        ('{"version": 1}', "version and objects"),
        ('{"version": 2, "objects": []}', "version 2"),
        ('{"version": "1", "objects": []}', "version '1'"),
        ('{"version": 1, "objects": [3]}', "object 0"),
        ('{"version": 1, "objects": [{}]}', "object 0.*points"),
        ("[" * 100_000, "JSON"),
    ],
)
def test_other_json_is_refused(text: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        Scene.from_json(text)


@rows("value", ['"a"', "[1, 2]", "[1, 2, NaN]", "null"])
def test_json_with_a_wrong_value_names_it(value: str) -> None:
    scene = random_scene(4, 1)
    center = json.dumps(scene.objects["center"][0].tolist())
    with pytest.raises(DataError, match=r"object 0.*center"):
        Scene.from_json(scene.to_json().replace(center, value))


@rows(
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
    whole = json.loads(coarse_scene().to_json())
    whole["image"] = {**whole["image"], **image} if isinstance(image, dict) and image else image
    with pytest.raises(DataError):
        Scene.from_json(json.dumps(whole))
