# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Read the mesh files that SDF refers to: COLLADA with pycollada, OBJ and STL with trimesh."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.errors import FusionSlamError
from fusionslam.sim.worlds.resource_paths import Library, MeshFolder
from fusionslam.sim.worlds.surfaces import Look, Piece, check_piece, rgb_of, triangles_of

_WHITE = (1.0, 1.0, 1.0)
# Exporters leave unused effects behind whose images are gone. If one is in use after all, the
# geometry that uses it reports another error.
_HARMLESS = re.compile("Missing (image|surface|sampler)|Effect not found")


def read_mesh(path: Path, library: Library, *, looks: bool) -> list[Piece]:
    """Pieces of one file in its own frame, metres; empty, and recorded, if it cannot be read.

    Args:
        path: an existing file.
        library: finds its textures and records what is missing.
        looks: True to read colours and textures; collision shapes need none.
    """
    readers = {".dae": _read_collada, ".obj": _read_trimesh, ".stl": _read_trimesh}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        library.missing.add("mesh", str(path), f"expected one of {', '.join(readers)}")
        return []
    try:
        return [check_piece(piece) for piece in reader(path, library, looks)]
    except FusionSlamError:
        raise
    except Exception as error:  # a damaged file can raise almost any exception in the readers
        library.missing.add("mesh", str(path), f"cannot be read: {type(error).__name__}: {error}")
        return []


def _read_collada(path: Path, library: Library, looks: bool) -> list[Piece]:
    """Read COLLADA as Gazebo does: apply the unit scale, ignore up_axis."""
    try:
        import collada
    except ImportError as error:
        raise FusionSlamError(
            "worlds in SDF need: pip install 'fusionslam[sim]'",
            code="missing-extra",
            fields=("sim",),
        ) from error
    document = collada.Collada(str(path), ignore=[collada.common.DaeError])
    if document.scene is None:
        raise ValueError("it has no scene")
    for lost in (str(error) for error in document.errors if not _HARMLESS.search(str(error))):
        library.missing.add("mesh", f"part of {path}", lost)
    if document.controllers:
        library.missing.add("mesh", f"skin in {path}", "moving skins are not supported")
    metres = document.assetInfo.unitmeter or 1.0
    pieces = []
    for geometry in document.scene.objects("geometry"):
        for primitive in geometry.primitives():
            piece = _collada_piece(primitive, metres, looks)
            if piece is not None:
                look = _collada_look(primitive, path, library) if looks else Look()
                pieces.append(Piece(piece.triangles, piece.uv, look))
    return pieces


def _collada_piece(primitive: Any, metres: float, looks: bool) -> Piece | None:
    from collada.triangleset import BoundTriangleSet

    if hasattr(primitive, "triangleset"):
        primitive = primitive.triangleset()
    if not isinstance(primitive, BoundTriangleSet) or not len(primitive):
        return None  # lines, or nothing
    corners = np.asarray(primitive.vertex, np.float64)[primitive.vertex_index] * metres
    if not looks or not primitive.texcoordset:
        return _without_lines(corners, None)
    at = np.asarray(primitive.texcoordset[0], np.float32)[:, :2]
    return _without_lines(corners, at[primitive.texcoord_indexset[0]])


def _without_lines(corners: NDArray[np.float64], uv: NDArray[np.float32] | None) -> Piece:
    """Leave out triangles with two identical corners, which are lines."""
    described = corners if uv is None else np.concatenate([corners, uv], axis=2)
    whole = (described != np.roll(described, 1, axis=1)).any(axis=2).all(axis=1)
    return Piece(corners[whole], None if uv is None else uv[whole])


def _collada_look(primitive: Any, path: Path, library: Library) -> Look:
    effect = getattr(primitive.material, "effect", None)
    if effect is None or effect.diffuse is None:
        return Look()
    if isinstance(effect.diffuse, tuple):
        return Look(effect.diffuse[:3])
    image = library.texture(effect.diffuse.sampler.surface.image.path, path)
    return Look() if image is None else Look(_WHITE, image)


def _read_trimesh(path: Path, library: Library, looks: bool) -> list[Piece]:
    import trimesh

    folder: Any = MeshFolder(library, path)
    scene = trimesh.load_scene(path, resolver=folder, process=False, skip_materials=not looks)
    meshes = [m for m in scene.dump() if isinstance(m, trimesh.Trimesh) and len(m.faces)]
    if not meshes:
        raise ValueError("it has no triangles")
    return [_trimesh_piece(mesh, looks) for mesh in meshes]


def _trimesh_piece(mesh: Any, looks: bool) -> Piece:
    corners = triangles_of(mesh)
    material = getattr(mesh.visual, "material", None)
    if not looks or material is None:
        return Piece(corners)
    uv = mesh.visual.uv
    if material.image is None or uv is None:
        return Piece(corners, None, Look(np.asarray(material.main_color[:3]) / 255.0))
    at = np.asarray(uv, np.float32)[:, :2]  # the third of a volume's texture is not used
    return Piece(corners, at[mesh.faces], Look(_WHITE, rgb_of(material.image)))
