# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Convert SDF geometry elements into pieces in the frame of their visual or collision."""

import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.base.arrays import Floats
from fusionslam.sim.worlds.meshes import read_mesh
from fusionslam.sim.worlds.resource_paths import Library
from fusionslam.sim.worlds.sdf_values import Color, numbers_of
from fusionslam.sim.worlds.surfaces import Look, Piece, triangles_of

# A sphere of 1280 triangles is 1.2 mm off at a radius of 0.3 m, a cylinder of 64 sides no more.
_BALL_SUBDIVISIONS = 3
_COLUMN_SIDES = 64
_UNIT_SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)


class GeometryReader:
    """Reads the geometries of one world; each mesh file is read once.

    Args:
        library: finds files and records what is missing.
        looks: True to read colours and textures.
    """

    def __init__(self, library: Library, looks: bool) -> None:
        self._library = library
        self._looks = looks
        self._meshes: dict[Path, list[Piece]] = {}

    def read(
        self, holder: ET.Element, folder: Path, owner: str, color: Color | None
    ) -> list[Piece]:
        """Pieces of a visual or collision; empty, and recorded as missing, if it cannot be read.

        Args:
            holder: the visual or collision element.
            folder: of the file that contains it.
            owner: name used in messages.
            color: of its own material, which replaces the materials of a mesh.
        """
        for shape in holder.findall("geometry/*"):
            if shape.tag == "empty":
                return []
            if shape.tag == "mesh":
                pieces = self._mesh(shape, folder, owner)
                if color is None:
                    return pieces
                return [Piece(piece.triangles, None, Look(color)) for piece in pieces]
            if shape.tag in _PRIMITIVES:
                corners = self._primitive(shape, f"{shape.tag} of {owner}")
                look = Look() if color is None else Look(color)
                return [] if corners is None else [Piece(corners, None, look)]
            self._note("geometry", f"<{shape.tag}> of {owner}", "not supported")
            return []
        self._note("geometry", f"of {owner}", "there is none in the file")
        return []

    def _mesh(self, mesh: ET.Element, folder: Path, owner: str) -> list[Piece]:
        uri = (mesh.findtext("uri") or "").strip()
        path = self._library.find(uri, folder)
        if path is None or not os.path.isfile(path):
            self._note("mesh", uri, f"named by {owner}, not found")
            return []
        if mesh.find("submesh") is not None:
            self._note("submesh", f"of {owner}", "not supported, all of the mesh is taken")
        if path not in self._meshes:
            self._meshes[path] = read_mesh(path, self._library, looks=self._looks)
        scale = self._numbers(mesh, "scale", 3, f"mesh of {owner}", default="1 1 1")
        if scale is None:
            return []
        return [piece.move(np.diag([*scale, 1.0])) for piece in self._meshes[path]]

    def _primitive(self, shape: ET.Element, owner: str) -> Floats | None:
        """Floats of one of ``_PRIMITIVES``; None, and recorded, if a value is wrong."""
        make, keys = _PRIMITIVES[shape.tag]
        values = [self._numbers(shape, key, count, owner, *rest) for key, count, *rest in keys]
        if any(numbers is None for numbers in values):
            return None
        if shape.tag == "plane" and not np.any(values[0]):
            self._note("number", f"normal of {owner}", "expected a direction, found zeros")
            return None
        return make(*values)

    def _numbers(
        self, shape: ET.Element, key: str, count: int, owner: str, default: str | None = None
    ) -> Floats | None:
        """``count`` numbers, positive if lengths; otherwise None, and recorded as missing."""
        numbers = numbers_of(
            shape.findtext(key, default), f"{key} of {owner}", self._library.missing
        )
        if numbers is None:
            return None
        if len(numbers) != count or (key in ("size", "radius", "length") and numbers.min() <= 0):
            text = " ".join(f"{number:g}" for number in numbers)
            self._note("number", f"{key} of {owner}", f"expected {count} above 0, found {text}")
            return None
        return numbers

    def _note(self, kind: str, name: str, why: str) -> None:
        self._library.missing.add(kind, name, why)


def _solid(kind: str, **sizes: Any) -> Floats:
    """A closed solid of ``trimesh.creation`` around the origin; sizes in metres."""
    import trimesh  # not needed for worlds without files

    return triangles_of(getattr(trimesh.creation, kind)(**sizes))


def _plane(normal: Floats, size: Floats) -> Floats:
    """Two triangles of a given size (2,) perpendicular to a normal (3,); SDF's planes end there."""
    upward = normal / np.linalg.norm(normal)
    helper = np.eye(3)[1 if abs(upward[1]) < 0.9 else 0]
    along = np.cross(helper, upward)
    along /= np.linalg.norm(along)
    across = np.cross(upward, along)
    steps = (_UNIT_SQUARE - 0.5) * size
    corners = steps[:, :1] * along + steps[:, 1:] * across
    halves: Floats = corners[np.array([(0, 1, 2), (0, 2, 3)])]
    return halves


# Function of each primitive, and its values: key, count of numbers, default if it may be missing.
_PRIMITIVES: Mapping[str, tuple[Callable[..., Floats], tuple[Any, ...]]] = {
    "box": (lambda size: _solid("box", extents=size), (("size", 3),)),
    "cylinder": (
        lambda radius, length: _solid(
            "cylinder", radius=radius.item(), height=length.item(), sections=_COLUMN_SIDES
        ),
        (("radius", 1), ("length", 1)),
    ),
    "sphere": (
        lambda radius: _solid("icosphere", subdivisions=_BALL_SUBDIVISIONS, radius=radius.item()),
        (("radius", 1),),
    ),
    "plane": (_plane, (("normal", 3, "0 0 1"), ("size", 2, "1 1"))),
}
