# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Worlds in binary glTF: visual shapes in NAME.glb, collision shapes in NAME.collision.glb.

glTF specifies y up; worlds here are stored z up, as usual in robotics, and are not rotated. The
base colour factor is read as a displayed colour: the specification says linear, but the tools that
write such worlds copy Gazebo's displayed colours.
"""

import json
import os
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.files import check_expansion, reading
from fusionslam.errors import DataError
from fusionslam.sim.scene import INDOOR_LIGHT, Scene
from fusionslam.sim.world import scene_of
from fusionslam.sim.worlds.ground import parts_of
from fusionslam.sim.worlds.resource_paths import Unresolved
from fusionslam.sim.worlds.surfaces import (
    Look,
    Piece,
    TexturePool,
    TriangleCount,
    check_piece,
    mesh_of,
    rgb_of,
    triangles_of,
)

_HEADER = struct.Struct("<4sII")
_CHUNK = struct.Struct("<I4s")
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
# Extensions that a file may require and that make no difference here, or that Pillow decodes.
_HARMLESS = ("KHR_materials_", "EXT_texture_webp")


def read_glb(path: Path, missing: Unresolved) -> Scene:
    """The scene of one file, with one object per node.

    Raises:
        DataError: no such file, not binary glTF 2, truncated, or without triangles.
    """
    _check(path, missing)
    objects = _objects(path)
    pool = TexturePool()
    if not objects:
        raise DataError(f"{path}: has no triangles, expected at least one mesh", code="empty-world")
    meshes = {name: mesh_of(pieces, pool) for name, pieces in objects.items()}
    return scene_of(parts_of(meshes), pool.textures, INDOOR_LIGHT)


def _check(path: Path, missing: Unresolved) -> None:
    """Refuse files that the reader would take for an empty world or read without textures."""
    header = _read_header(path)
    needed = [n for n in header.get("extensionsRequired", ()) if not n.startswith(_HARMLESS)]
    if needed:
        raise DataError(f"{path}: requires {', '.join(needed)}, expected glTF without extensions")
    with reading(path, "binary glTF"):
        # Arrays that would take more memory than the file can fill are refused.
        numbers = sum(
            max(int(each["count"]), 0) * _COMPONENTS.get(each["type"], 16)
            for each in header.get("accessors", ())
        )
        check_expansion(4 * numbers, path.stat().st_size)
    folder = os.path.abspath(path.parent)
    for uri in (image.get("uri", "data:") for image in header.get("images", ())):
        if uri.startswith("data:"):
            continue
        place = Path(os.path.abspath(path.parent / unquote(uri)))
        if not place.is_relative_to(folder):
            missing.add("texture", uri, f"is not in {path.parent}")
        elif not (path.parent / uri).is_file():
            missing.add("texture", uri, f"no such file in {path.parent}")


def _read_header(path: Path) -> dict[str, Any]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}, expected a binary glTF file") from error
    if len(data) < _HEADER.size + _CHUNK.size or data[:4] != b"glTF":
        raise DataError(
            f"{path}: not binary glTF: expected it to begin with glTF and its length",
            code="not-gltf",
        )
    _, version, length = _HEADER.unpack_from(data)
    if version != 2:
        raise DataError(f"{path}: glTF version {version}, expected 2", code="gltf-version")
    if len(data) < length:
        raise DataError(
            f"{path}: truncated: {len(data)} bytes, its header says {length}", code="truncated"
        )
    size, _ = _CHUNK.unpack_from(data, _HEADER.size)
    start = _HEADER.size + _CHUNK.size
    try:
        header = json.loads(data[start : start + size])
    except (ValueError, RecursionError) as error:
        raise DataError(
            f"{path}: its JSON part cannot be read: {error}", code="gltf-header"
        ) from error
    if not isinstance(header, dict):
        raise DataError(f"{path}: its JSON part is not an object", code="gltf-header")
    return header


def _objects(path: Path) -> dict[str, list[Piece]]:
    """Pieces of each node in the world's frame, in file order."""
    import trimesh

    try:
        return _pieces(trimesh.load_scene(path, file_type="glb", process=False))
    except DataError:
        raise
    except Exception as error:  # a damaged file can raise almost any exception in the reader
        raise DataError(
            f"{path}: damaged binary glTF: {type(error).__name__}: {error}", code="damaged"
        ) from error


def _pieces(scene: Any) -> dict[str, list[Piece]]:
    order = {name: number for number, name in enumerate(scene.geometry)}
    found: dict[str, list[Piece]] = {}
    count = TriangleCount()
    nodes = [(*scene.graph[node], node) for node in scene.graph.nodes_geometry]
    for world_from_node, geometry, node in sorted(nodes, key=lambda n: (order[n[1]], n[2])):
        mesh = scene.geometry[geometry]
        if getattr(mesh, "faces", None) is not None and len(mesh.faces):
            # The reader adds a child node for each material of a mesh.
            split = mesh.metadata.get("from_gltf_primitive")
            name = str(scene.graph.transforms.parents[node] if split else node)
            (piece,) = count.add([check_piece(_piece(mesh))])
            found.setdefault(name, []).append(piece.move(world_from_node))
    return found


def _piece(mesh: Any) -> Piece:
    corners = triangles_of(mesh)
    material = getattr(mesh.visual, "material", None)
    if material is None:
        return Piece(corners, None, Look(_vertex_tint(mesh.visual.vertex_colors, mesh.faces)))
    tint: NDArray[Any] = np.ones(3)
    if material.baseColorFactor is not None:
        tint = np.asarray(material.baseColorFactor)[:3] / 255.0
    colors = getattr(mesh.visual, "vertex_attributes", {}).get("color")
    if colors is not None:
        tint = tint * _vertex_tint(colors, mesh.faces)
    uv = mesh.visual.uv
    if material.baseColorTexture is None or uv is None:
        return Piece(corners, None, Look(tint))
    return Piece(
        corners,
        np.asarray(uv, np.float32)[mesh.faces],
        Look(tint, rgb_of(material.baseColorTexture)),
    )


def _vertex_tint(colors: NDArray[Any], faces: NDArray[Any]) -> NDArray[np.float64]:
    """Mean colour of each triangle's corners, (T, 3), from RGB or RGBA as integers or 0 .. 1."""
    values = np.asarray(colors)
    largest = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else 1.0
    means: NDArray[np.float64] = (values[:, :3].astype(np.float64) / largest)[faces].mean(axis=1)
    return means
