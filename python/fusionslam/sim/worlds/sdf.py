# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Read Gazebo SDF worlds as static visual and collision scenes."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from fusionslam.errors import DataError
from fusionslam.sim.mesh import Mesh
from fusionslam.sim.scene import INDOOR_LIGHT, Scene
from fusionslam.sim.world import scene_of
from fusionslam.sim.worlds.geometry import GeometryReader
from fusionslam.sim.worlds.ground import LARGE_M2, area_m2, level_triangles, parts_of
from fusionslam.sim.worlds.models import Shape, shapes_of
from fusionslam.sim.worlds.resource_paths import Library, Unresolved
from fusionslam.sim.worlds.sdf_values import color_of
from fusionslam.sim.worlds.surfaces import Piece, TexturePool, TriangleCount, mesh_of

# How far a visual plane is lowered below a floor laid on it, and the tolerance for "on it".
_SUNK_M = 0.01
_LAID_M = 0.005


def read_sdf(path: Path, missing: Unresolved) -> tuple[Scene, Scene]:
    """Visual and collision scene of a world file, with one object per model of the world.

    Raises:
        DataError: the file is not XML, contains no world, or has neither visual nor collision
            shapes.
    """
    library = Library(path, missing)
    shapes = list(shapes_of(path, library))
    visual = _scene(shapes, "visual", library)
    collision = _scene(shapes, "collision", library)
    seen, hit = visual or collision, collision or visual
    if seen is None or hit is None:
        listed = "".join(f"\n  {item}" for item in missing.items)
        raise DataError(
            f"{path}: it has no visual and no collision shapes{listed}", code="empty-world"
        )
    return seen, hit


def _scene(shapes: Iterable[Shape], kind: str, library: Library) -> Scene | None:
    """The scene of all visuals or all collisions; None if there are none."""
    reader = GeometryReader(library, looks=kind == "visual")
    pieces: dict[str, list[Piece]] = {}
    planes: set[str] = set()
    count = TriangleCount()
    for shape in shapes:
        if shape.element.tag != kind:
            continue
        name = shape.model
        if shape.element.find("geometry/plane") is not None:
            planes.add(name)
        color = color_of(shape.element.find("material"), shape.owner, library.missing)
        found = count.add(reader.read(shape.element, shape.folder, shape.owner, color))
        placed = [piece.move(shape.world_from_shape) for piece in found]
        pieces.setdefault(name, []).extend(placed)
    pool = TexturePool()
    meshes = {name: mesh_of(parts, pool) for name, parts in pieces.items() if parts}
    if not meshes:
        return None
    if kind == "visual":
        meshes = _lower_planes(meshes, planes & meshes.keys())
    return scene_of(parts_of(meshes), pool.textures, INDOOR_LIGHT)


def _lower_planes(meshes: Mapping[str, Mesh], planes: Iterable[str]) -> dict[str, Mesh]:
    """Lower ground planes below floors at the same height, where visibility would be ambiguous."""
    sunk = dict(meshes)
    for name in planes:
        height = float(np.median(meshes[name].triangles[:, :, 2]))
        if level_triangles(meshes[name], height, _LAID_M).all() and any(
            area_m2(mesh, level_triangles(mesh, height, _LAID_M)) >= LARGE_M2
            for other, mesh in meshes.items()
            if other not in planes
        ):
            down = np.array([0, 0, -_SUNK_M], np.float32)
            sunk[name] = replace(meshes[name], triangles=meshes[name].triangles + down)
    return sunk
