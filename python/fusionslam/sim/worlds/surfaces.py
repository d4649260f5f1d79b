# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Convert surfaces read from files (pieces with looks) into meshes and textures."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from fusionslam.base.files import check_pixels
from fusionslam.errors import DataError
from fusionslam.sim.mesh import Mesh

# Larger images are halved until they fit: no camera comes close enough to see their finest texels,
# and one of 8192 x 8192 alone takes 700 MB with its mipmaps.
LARGEST_SIDE = 2048
MOST_TRIANGLES = 20_000_000
"""Of a world: a small file can place one large mesh many thousand times."""
# The colour that Gazebo and most viewers use without a material.
PLAIN = (0.7, 0.7, 0.7)


@dataclass(frozen=True, eq=False)
class Look:
    """Appearance of a piece.

    Attributes:
        tint: RGB factor, 0 .. 1, as displayed: (3,), or (T, 3) for one per triangle.
        image: uint8 (H, W, 3), or None for a plain colour.
    """

    tint: ArrayLike = PLAIN
    image: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class Piece:
    """Triangles that share a look.

    Attributes:
        triangles: float64 (T, 3, 3), corners in metres, counter-clockwise seen from outside.
        uv: float32 (T, 3, 2), texture coordinates in images, v upwards; None without an image.
        look: their appearance.
    """

    triangles: NDArray[np.float64]
    uv: NDArray[np.float32] | None = None
    look: Look = field(default_factory=Look)

    def move(self, to_from: NDArray[np.float64]) -> "Piece":
        """The piece in another frame, (4, 4); after a mirroring the outside stays outside."""
        corners = self.triangles @ to_from[:3, :3].T + to_from[:3, 3]
        if np.linalg.det(to_from[:3, :3]) >= 0:
            return Piece(corners, self.uv, self.look)
        uv = None if self.uv is None else self.uv[:, ::-1]
        return Piece(corners[:, ::-1], uv, self.look)


def check_piece(piece: Piece) -> Piece:
    """Check a piece and return it.

    Raises:
        ValueError: a corner or a texture coordinate is not finite, or has another number of
            coordinates.
    """
    if piece.triangles.shape[1:] != (3, 3):
        raise ValueError(f"corners are {piece.triangles.shape[1:]}, expected (3, 3) a triangle")
    if not np.isfinite(piece.triangles).all():
        raise ValueError("a corner is not finite")
    if piece.uv is not None and piece.uv.shape[1:] != (3, 2):
        raise ValueError(f"texture coordinates are {piece.uv.shape[1:]}, expected (3, 2)")
    if piece.uv is not None and not np.isfinite(piece.uv).all():
        raise ValueError("a texture coordinate is not finite")
    return piece


class TriangleCount:
    """Counts the triangles of a world."""

    def __init__(self) -> None:
        self._count = 0

    def add(self, pieces: Sequence[Piece]) -> Sequence[Piece]:
        """Count pieces and return them. Raises DataError for too many triangles."""
        self._count += sum(len(piece.triangles) for piece in pieces)
        if self._count > MOST_TRIANGLES:
            raise DataError(
                f"the world has more than {MOST_TRIANGLES} triangles", code="too-many-triangles"
            )
        return pieces


class TexturePool:
    """The textures of a scene, each stored once even if several files or materials use it.

    Attributes:
        textures: uint8 (H, W, 4) each, RGB and a tint mask that is 255 everywhere.
    """

    def __init__(self) -> None:
        self.textures: list[NDArray[np.uint8]] = []
        self._index: dict[tuple[tuple[int, ...], bytes], int] = {}

    def index(self, image: NDArray[np.uint8] | None) -> int:
        """Index of the texture of an image, uint8 (H, W, 3); None stands for one white texel."""
        pixels = np.full((1, 1, 3), 255, np.uint8) if image is None else np.ascontiguousarray(image)
        key = (pixels.shape, hashlib.sha256(pixels.tobytes()).digest())
        if key not in self._index:
            self._index[key] = len(self.textures)
            mask = np.full((*pixels.shape[:2], 1), 255, np.uint8)
            self.textures.append(np.concatenate([pixels, mask], axis=2))
        return self._index[key]


def mesh_of(pieces: Sequence[Piece], pool: TexturePool) -> Mesh:
    """One mesh of all pieces' triangles, in order, including those without area."""
    corners = np.concatenate([piece.triangles for piece in pieces])
    counts = [len(piece.triangles) for piece in pieces]
    textures = np.array([pool.index(piece.look.image) for piece in pieces], np.int32)
    tints = [np.broadcast_to(p.look.tint, (n, 3)) for p, n in zip(pieces, counts, strict=True)]
    uv = [np.zeros((len(p.triangles), 3, 2)) if p.uv is None else p.uv for p in pieces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    # Triangles without area are never hit, but need a valid unit normal.
    normals = np.where(length > 0, cross / np.maximum(length, 1e-300), (0.0, 0.0, 1.0))
    return Mesh(
        corners.astype(np.float32),
        np.concatenate(uv).astype(np.float32),
        np.repeat(textures, counts),
        np.concatenate(tints).astype(np.float32),
        normals.astype(np.float32),
    )


def rgb_of(image: Image.Image) -> NDArray[np.uint8]:
    """Pixels of an image of any mode, uint8 (H, W, 3), at most LARGEST_SIDE wide and high.

    Transparency is ignored: transparent texels keep their stored colours.

    Raises:
        OSError, ValueError, SyntaxError: raised by Pillow if it cannot decode the image.
    """
    check_pixels(image)
    halvings = 0
    while max(image.size) >> halvings > LARGEST_SIDE:
        halvings += 1
    rgb = image.convert("RGB")
    return np.asarray(rgb.reduce(1 << halvings) if halvings else rgb, np.uint8)


def triangles_of(mesh: Any) -> NDArray[np.float64]:
    """Corners of a trimesh mesh, (T, 3, 3)."""
    corners: NDArray[np.float64] = np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)]
    return corners
