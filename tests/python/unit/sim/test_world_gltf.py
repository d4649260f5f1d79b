# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds in binary glTF, made here byte by byte so that no other writer's habits come in."""

import io
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from error_codes import has_code
from fusionslam.errors import DataError
from fusionslam.geometry.trajectory import Trajectory, write_trajectory
from fusionslam.sim.scene import Scene
from fusionslam.sim.worlds import load_world
from rows import rows

SQUARE = np.array([(0, 0, 0.5), (1, 0, 0.5), (1, 2, 0.5), (0, 2, 0.5)], np.float32)
# Upper row red and green, lower row blue and yellow.
FOUR = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], np.uint8)


class Glb:
    """Collects a file's parts; ``bytes`` puts them together as the specification says."""

    def __init__(self) -> None:
        self.data = b""
        self.header: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            **{key: [] for key in ("nodes", "meshes", "accessors", "bufferViews", "materials")},
        }

    def view(self, content: bytes) -> int:
        self.header["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)}
        )
        self.data += content + b"\0" * (-len(content) % 4)
        return len(self.header["bufferViews"]) - 1

    def array(self, values: np.ndarray, kind: str) -> int:
        types = {"float32": 5126, "uint32": 5125, "uint8": 5121}
        accessor = {
            "bufferView": self.view(values.tobytes()),
            "componentType": types[str(values.dtype)],
            "count": len(values),
            "type": kind,
        }
        if values.dtype == np.uint8:
            accessor["normalized"] = True
        self.header["accessors"].append(accessor)
        return len(self.header["accessors"]) - 1

    def square(self, material: dict[str, Any] | None, **attributes: int) -> dict[str, Any]:
        """A primitive of two triangles over 1 x 2 m at z = 0.5."""
        faces = np.array([0, 1, 2, 0, 2, 3], np.uint32)
        primitive: dict[str, Any] = {
            "attributes": {"POSITION": self.array(SQUARE, "VEC3"), **attributes},
            "indices": self.array(faces, "SCALAR"),
        }
        if material is not None:
            self.header["materials"].append({"pbrMetallicRoughness": material})
            primitive["material"] = len(self.header["materials"]) - 1
        return primitive

    def node(self, name: str, *primitives: dict[str, Any], **place: Any) -> None:
        self.header["meshes"].append({"primitives": list(primitives)})
        mesh = len(self.header["meshes"]) - 1
        self.header["nodes"].append({"name": name, "mesh": mesh, **place})
        self.header["scenes"][0]["nodes"].append(len(self.header["nodes"]) - 1)

    def texture(self, pixels: np.ndarray) -> dict[str, Any]:
        """A material's entry for a picture inside the file."""
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "PNG")
        view = self.view(file.getvalue())
        return self.image({"bufferView": view, "mimeType": "image/png"})

    def image(self, image: dict[str, Any]) -> dict[str, Any]:
        for key, entry in (("images", image), ("textures", {"source": 0})):
            self.header.setdefault(key, []).append(entry)
        self.header["textures"][-1] = {"source": len(self.header["images"]) - 1}
        return {"baseColorTexture": {"index": len(self.header["textures"]) - 1}}

    def uv(self) -> int:
        """glTF counts v downwards: the first corner of the square is the image's lower left."""
        return self.array(np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32), "VEC2")

    def bytes(self) -> bytes:
        header = {key: value for key, value in self.header.items() if value != []}
        if self.data:
            header["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(header).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(self.data), b"BIN\0") + self.data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def write(self, path: Path) -> Path:
        path.write_bytes(self.bytes())
        return path


def square_world(path: Path) -> Path:
    glb = Glb()
    glb.node("square", glb.square({"baseColorFactor": [0.2, 0.4, 0.6, 1]}))
    return glb.write(path)


def of(scene: Scene, name: str) -> np.ndarray:
    return np.asarray(scene.part == list(scene.names).index(name))


def test_nodes_are_objects_where_their_transforms_put_them_with_z_up(tmp_path: Path) -> None:
    glb = Glb()
    glb.node("here", glb.square(None))
    glb.node("there", glb.square(None), translation=[5, 6, 7], scale=[1, 1, 2])
    world = load_world(glb.write(tmp_path / "two.glb"))
    assert world.name == "two" and set(world.visual.names) == {"here", "there"}
    here = world.visual.mesh.triangles[of(world.visual, "here")]
    there = world.visual.mesh.triangles[of(world.visual, "there")]
    np.testing.assert_allclose(here, SQUARE[[[0, 1, 2], [0, 2, 3]]])
    np.testing.assert_allclose(there, here * [1, 1, 2] + [5, 6, 7], rtol=1e-6)
    np.testing.assert_allclose(world.visual.mesh.normals, [[0, 0, 1]] * 4)


def test_a_node_is_one_object_and_a_picture_one_texture(tmp_path: Path) -> None:
    glb = Glb()
    glb.node("desk", *(glb.square({"baseColorFactor": [c, 0, 0, 1]}) for c in (0.2, 0.8)))
    scene = load_world(glb.write(tmp_path / "desk.glb")).visual
    assert list(scene.names) == ["desk"] and len(scene.mesh) == 4
    glb = Glb()
    for name in ("a", "b"):
        glb.node(name, glb.square(glb.texture(FOUR), TEXCOORD_0=glb.uv()))
    assert len(load_world(glb.write(tmp_path / "twice.glb")).visual.textures) == 1


def test_materials_are_textures_with_v_upwards_and_tints_as_displayed(tmp_path: Path) -> None:
    scene = load_world(square_world(tmp_path / "plain.glb")).visual
    assert [texture.tolist() for texture in scene.textures] == [[[[255] * 4]]]
    np.testing.assert_allclose(scene.mesh.tint, [[0.2, 0.4, 0.6]] * 2, atol=0.5 / 255)
    glb = Glb()
    material = {"baseColorFactor": [1, 0.5, 1, 1], **glb.texture(FOUR)}
    glb.node("poster", glb.square(material, TEXCOORD_0=glb.uv()))
    scene = load_world(glb.write(tmp_path / "poster.glb")).visual
    np.testing.assert_array_equal(scene.textures[0][..., :3], FOUR)
    np.testing.assert_array_equal(scene.textures[0][..., 3], 255)
    np.testing.assert_allclose(scene.mesh.uv[..., 0], scene.mesh.triangles[..., 0])
    np.testing.assert_allclose(scene.mesh.uv[..., 1], scene.mesh.triangles[..., 1] / 2)
    np.testing.assert_allclose(scene.mesh.tint, [[1, 0.5, 1]] * 2, atol=0.5 / 255)


def test_vertex_colours_tint_each_triangle_with_their_mean(tmp_path: Path) -> None:
    colors = np.array([(0, 0, 0, 255), (0, 255, 0, 255), (0, 0, 255, 255), (255,) * 4], np.uint8)
    expected = colors[[[0, 1, 2], [0, 2, 3]]][..., :3].mean(axis=1) / 255
    for name, material in (("bare", None), ("tinted", {"baseColorFactor": [0.5, 0.5, 0.5, 1]})):
        glb = Glb()
        glb.node("quilt", glb.square(material, COLOR_0=glb.array(colors, "VEC4")))
        scene = load_world(glb.write(tmp_path / f"{name}.glb")).visual
        factor = 1 if material is None else 0.5
        np.testing.assert_allclose(scene.mesh.tint, expected * factor, atol=1 / 255)


def test_collision_map_and_trajectory_lie_beside_the_world(tmp_path: Path) -> None:
    path = square_world(tmp_path / "room.glb")
    alone = load_world(path)
    assert alone.collision is alone.visual and alone.map is None and alone.trajectory is None
    glb = Glb()
    glb.node("simple", glb.square(None))
    glb.write(tmp_path / "room.collision.glb")
    row = np.array([0.0, 1.0])
    write_trajectory(tmp_path / "room.trajectory.csv", Trajectory(row, row, row, row * 0))
    Image.new("L", (4, 3), 254).save(tmp_path / "room.map.pgm")
    (tmp_path / "room.map.yaml").write_text(
        "image: room.map.pgm\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    world = load_world(path)
    assert list(world.collision.names) == ["simple"]
    assert world.trajectory is not None and len(world.trajectory) == 2
    assert world.map is not None and world.map.occupied.shape == (3, 4)


def with_accessor(**accessor: Any) -> Callable[[bytes], bytes]:
    """A square whose file says of one more array what cannot be."""

    def make(_: bytes) -> bytes:
        glb = Glb()
        glb.node("square", glb.square(None))
        glb.header["accessors"].append(accessor)
        return glb.bytes()

    return make


def nested_without_end(_: bytes) -> bytes:
    text = b'{"asset":' * 100_000
    start = struct.pack("<4sII", b"glTF", 2, 20 + len(text))
    return start + struct.pack("<I4s", len(text), b"JSON") + text


NAN = np.array([0, np.nan, 0.5], np.float32).tobytes()
FLOATS = {"type": "VEC3", "componentType": 5126}


@rows(
    "codes, change",
    [
        ("not-gltf", lambda data: b""),
        ("not-gltf truncated", lambda data: data[: len(data) // 100]),
        ("not-gltf truncated", lambda data: data[: len(data) // 30]),
        ("truncated", lambda data: data[: len(data) // 10]),
        ("truncated", lambda data: data[: len(data) // 2]),
        ("truncated", lambda data: data[:-9]),
        ("not-gltf", lambda data: b"PK" + data[2:]),
        ("gltf-version", lambda data: data[:4] + struct.pack("<I", 1) + data[8:]),
        ("gltf-header", lambda data: data[:20] + b"#" + data[21:]),
        ("gltf-header", nested_without_end),
        ("damaged", lambda data: data.replace(b'"bufferView": 1', b'"bufferView": 9')),
        ("damaged-file", with_accessor(count=2_000_000_000, **FLOATS | {"type": "MAT4"})),
        ("damaged-file", with_accessor(count="many", **FLOATS)),
        ("damaged-file", with_accessor(count=10**400, **FLOATS)),
        ("empty-world", lambda data: Glb().bytes()),
        ("", lambda data: data.replace(SQUARE[0].tobytes(), NAN)),
    ],
)
def test_other_and_damaged_files_are_refused(
    tmp_path: Path, codes: str, change: Callable[[bytes], bytes]
) -> None:
    path = square_world(tmp_path / "other.glb")
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(DataError, match=r"other\.glb") as error:
        load_world(path)
    assert not codes or error.value.code in codes.split()


def test_required_extensions_and_missing_pictures_are_named(tmp_path: Path) -> None:
    glb = Glb()
    glb.node("square", glb.square(None))
    glb.header["extensionsRequired"] = ["KHR_materials_unlit", "KHR_texture_basisu"]
    with pytest.raises(DataError, match="KHR_texture_basisu"):
        load_world(glb.write(tmp_path / "packed.glb"))
    glb = Glb()
    glb.node("poster", glb.square(glb.image({"uri": "gone.png"}), TEXCOORD_0=glb.uv()))
    path = glb.write(tmp_path / "poster.glb")
    with pytest.raises(DataError, match=r"gone\.png"):
        load_world(path)
    world = load_world(path, lenient=True)
    assert len(world.visual.mesh) == 2 and "gone.png" in world.unresolved[0]


@rows("uri", ["../secret.png", "%2e%2e/secret.png", "{outside}/secret.png"])
def test_images_outside_of_the_file_s_folder_are_not_read(tmp_path: Path, uri: str) -> None:
    Image.fromarray(FOUR).save(tmp_path / "secret.png")
    glb = Glb()
    material = glb.image({"uri": uri.replace("{outside}", str(tmp_path))})
    glb.node("square", glb.square(material, TEXCOORD_0=glb.uv()))
    (tmp_path / "in").mkdir()
    path = glb.write(tmp_path / "in" / "hostile.glb")
    with pytest.raises(DataError, check=has_code("unresolved")):
        load_world(path)
    load_world(path, lenient=True)
