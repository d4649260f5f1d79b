# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Find the ground triangles of a loaded world; world files do not mark them.

A whole object is ground if its name says so and it is low. In any other object, level triangles
that face up at ground height are ground if their total area is large: for example the floor of a
hall that is one object with its walls. Thin things on that floor belong to it, edges included:
painted lines, mats, thresholds.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fusionslam.sim.mesh import Mesh
from fusionslam.sim.world import Part

GROUND_WORDS = {"floor", "ground", "carpet", "rug", "road", "pavement", "asphalt"}
# Metres. Robots of this size drive over lower objects.
LOW_M = 0.05
# Things on a floor that are no thicker than this are part of it.
THIN_M = 0.02
# Square metres per object: a smaller level area is the bottom of a shelf, or a book.
LARGE_M2 = 1.0
LEVEL_COSINE = 0.99


def parts_of(meshes: Mapping[str, Mesh]) -> list[Part]:
    """One part per object, or two if it includes a floor: "hall" and "hall ground"."""
    return [part for name, mesh in meshes.items() for part in _parts(name, mesh)]


def level_triangles(
    mesh: Mesh, height_m: float = 0.0, within_m: float = LOW_M
) -> NDArray[np.bool_]:
    """True for level triangles that face up within ``within_m`` of a height, bool (T,)."""
    level = mesh.normals[:, 2] > LEVEL_COSINE
    near = np.abs(mesh.triangles[:, :, 2] - height_m).max(axis=1) <= within_m
    return np.asarray(level & near)


def area_m2(mesh: Mesh, chosen: NDArray[np.bool_]) -> float:
    """Area of the chosen triangles, square metres."""
    a, b, c = mesh.triangles[chosen].astype(np.float64).transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _parts(name: str, mesh: Mesh) -> Sequence[Part]:
    # Words of a name like "aws_FloorB_01" or "ground_plane".
    words = {word.lower() for word in re.findall(r"[A-Z]?[a-z]+", name)}
    if words & GROUND_WORDS and mesh.triangles[:, :, 2].max() <= LOW_M:
        return [Part(name, mesh, is_ground=True)]
    level = level_triangles(mesh)
    if area_m2(mesh, level) < LARGE_M2:
        return [Part(name, mesh)]
    thin = np.abs(mesh.triangles[:, :, 2]).max(axis=1) <= THIN_M
    floor = level | (thin & (mesh.normals[:, 2] > -LEVEL_COSINE))
    if floor.all():
        return [Part(name, mesh, is_ground=True)]
    return [
        Part(name, mesh.select(~floor)),
        Part(f"{name} ground", mesh.select(floor), is_ground=True),
    ]
