# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes as bytes and as JSON: small, true to the scene, and suspicious of everything else."""

import binascii
import json
import resource

import numpy as np
import pytest

from fusionslam import DataError
from fusionslam.views import Scene, build_scene

EMPTY = build_scene(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8))
# How far a number may be from what was stored: half a step.
HALF_STEPS = {"center": 5e-5, "volume": 1e-5, "area": 1e-4, "color": 2**-11, "extents": 5e-5}


def random_scene(seed: int, size: int) -> Scene:
    """Objects as a robot sees them indoors."""
    rng = np.random.default_rng(seed)
    objects = np.zeros(size, EMPTY.objects.dtype)
    objects["center"] = rng.uniform([1, -5, 0], [9, 5, 2], (size, 3))
    objects["extents"] = np.sort(rng.uniform(0, 2, (size, 3)))[:, ::-1]
    objects["volume"] = rng.uniform(0.2, 0.6, size) * objects["extents"].prod(axis=1)
    objects["area"] = rng.uniform(0, 12, size)
    objects["color"] = rng.uniform(0, 255, (size, 3))
    objects["points"] = rng.integers(10, 600, size)
    return Scene(objects)


@pytest.mark.parametrize("size", [0, 1, 5, 300])
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


def test_a_scene_from_bytes_gives_the_same_bytes() -> None:
    data = random_scene(3, 20).to_bytes()
    assert Scene.from_bytes(data).to_bytes() == data


def test_a_view_takes_about_a_hundred_bytes() -> None:
    assert len(EMPTY.to_bytes()) == 7
    assert len(random_scene(0, 1).to_bytes()) <= 40
    assert len(random_scene(0, 3).to_bytes()) <= 100
    assert len(random_scene(0, 100).to_bytes()) <= 100 * 29


def test_flat_small_and_distant_objects_are_stored() -> None:
    objects = random_scene(1, 3).objects.copy()
    objects["volume"][0], objects["area"][1], objects["center"][2] = 0, 0, [-3e6, 3e6, 0]
    objects["points"][2] = 2**40
    back = Scene.from_bytes(Scene(objects).to_bytes()).objects
    assert (back["volume"][0], back["area"][1], back["points"][2]) == (0, 0, 2**40)
    np.testing.assert_allclose(back["center"][2], [-3e6, 3e6, 0], atol=1e-4)


def test_values_that_cannot_be_stored_are_refused() -> None:
    objects = random_scene(1, 1).objects.copy()
    objects["center"] = 1e30
    with pytest.raises(DataError, match=r"center .*1e\+30"):
        Scene(objects).to_bytes()
    objects = random_scene(1, 1).objects.copy()
    objects["volume"] = -1
    with pytest.raises(DataError, match=r"volume .*-1"):
        Scene(objects).to_bytes()


@pytest.mark.parametrize("size", [0, 1, 4])
def test_cut_bytes_are_refused(size: int) -> None:
    data = random_scene(2, size).to_bytes()
    for length in range(len(data)):
        with pytest.raises(DataError):
            Scene.from_bytes(data[:length])
    with pytest.raises(DataError):
        Scene.from_bytes(data + b"\0")


def test_any_damaged_bit_is_noticed() -> None:
    data = random_scene(2, 4).to_bytes()
    for bit in range(8 * len(data)):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DataError):
            Scene.from_bytes(bytes(damaged))


def test_bytes_of_another_version_say_so() -> None:
    data = bytearray(random_scene(2, 4).to_bytes())
    data[1] = 9
    with pytest.raises(DataError, match=r"9.*1"):
        Scene.from_bytes(bytes(data))


def test_foreign_bytes_are_refused() -> None:
    rng = np.random.default_rng(0)
    for length in range(200):
        with pytest.raises(DataError):
            Scene.from_bytes(rng.bytes(length))
    with pytest.raises(DataError):
        Scene.from_bytes(b"\x89PNG")


def crc(data: bytes) -> bytes:
    """CRC-16/CCITT."""
    return binascii.crc_hqx(data, 0xFFFF).to_bytes(2, "little")


def test_sections_of_later_programs_are_passed_over() -> None:
    scene = random_scene(2, 4)
    data = scene.to_bytes()[:-2]
    longer = data + bytes([77, 3]) + b"new"
    assert Scene.from_bytes(longer + crc(longer)) == Scene.from_bytes(scene.to_bytes())


@pytest.mark.parametrize(
    "content", [b"\1\xff", b"\1\5\4", b"\1\1\xff", b"\1\7\xff\xff\xff\xff\xff\xff\7", b"\xff" * 20]
)
def test_nonsense_with_a_right_checksum_is_refused(content: bytes) -> None:
    data = b"\x5c\1" + content
    with pytest.raises(DataError):
        Scene.from_bytes(data + crc(data))


def varint(value: int) -> bytes:
    return bytes([value]) if value < 128 else bytes([value & 127 | 128]) + varint(value >> 7)


def section(kind: int, bits: str) -> bytes:
    """A section's bytes of bits, the first of which are the lowest."""
    padded = bits + "0" * (-len(bits) % 8)
    content = int(padded[::-1], 2).to_bytes(len(padded) // 8, "little")
    return varint(kind) + varint(len(content)) + content


def small(value: int, order: int) -> str:
    """An exponential Golomb code."""
    high = (value >> order) + 1
    width = high.bit_length() - 1
    return "0" * width + "1" + plain(high - (1 << width), width) + plain(value, order)


def plain(value: int, width: int) -> str:
    return "".join(str(value >> i & 1) for i in range(width))


def scene_of(*sections: bytes) -> bytes:
    data = b"\x5c\1" + b"".join(sections)
    return data + crc(data)


def image_bits(rows: int, columns: int, runs: list[int]) -> str:
    steps = plain(int(np.float32(0.1).view(np.uint32)), 32) * 2
    box = small(0, 4) + small(0, 6) + small(rows, 4) + small(columns, 6)
    return steps + plain(0, 96) + box + "".join(small(run, 2) for run in runs)


def test_bytes_that_name_more_cells_than_they_hold_take_no_memory() -> None:
    bits = image_bits(7200, 7200, [0, 7200 * 7200])
    bomb = scene_of(section(2, bits))
    assert len(bomb) < 50
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DataError):
        Scene.from_bytes(bomb)
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert after - before < 50_000  # kB; all cells would take 500 MB


def test_a_cell_of_the_fewest_bits_is_read() -> None:
    cells = image_bits(1, 3, [0, 3]) + (small(0, 3) + 3 * small(0, 1)) * 3
    assert len(Scene.from_bytes(scene_of(section(2, cells))).image) == 3


def test_bytes_of_more_than_a_million_objects_are_refused() -> None:
    count = 8_000_000
    named = "".join(plain(byte, 8) for byte in varint(count))
    bits = named + plain(1, 6) + "1" * count + plain(0, 30)
    with pytest.raises(DataError):
        Scene.from_bytes(scene_of(section(1, bits)))


def test_objects_without_points_are_refused() -> None:
    def objects(points: int) -> bytes:
        bits = plain(1, 8) + plain(1, 6) + plain(points, 1) + plain(0, 30)
        return scene_of(section(1, bits))

    assert len(Scene.from_bytes(objects(1))) == 1
    with pytest.raises(DataError):
        Scene.from_bytes(objects(0))


def test_json_is_exact_and_readable() -> None:
    scene = random_scene(4, 3)
    text = scene.to_json()
    assert Scene.from_json(text) == scene
    entries = json.loads(text)["objects"]
    assert entries[1]["center"] == scene.objects["center"][1].tolist()
    assert len(text.splitlines()) == 5
    assert Scene.from_json(EMPTY.to_json()) == EMPTY


@pytest.mark.parametrize(
    ("text", "message"),
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


@pytest.mark.parametrize("value", ['"a"', "[1, 2]", "[1, 2, NaN]", "null"])
def test_json_with_a_wrong_value_names_it(value: str) -> None:
    scene = random_scene(4, 1)
    center = json.dumps(scene.objects["center"][0].tolist())
    with pytest.raises(DataError, match=r"object 0.*center"):
        Scene.from_json(scene.to_json().replace(center, value))
