# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Textured triangle meshes and the basic shapes that worlds are built from.

Metres, z up. Texture coordinates are in images: (0, 0) is the lower left corner of the image,
(1, 1) the upper right one, and images repeat.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusionslam.base.arrays import Floats32

Rgb = tuple[float, float, float]

_BOX_FACES = ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7), (3, 2, 1, 0))


class Texture(IntEnum):
    """Base of enumerations of textures: a member is the index of a texture in its scene.

    Attributes:
        extent: width and height in metres that one image covers at its natural size.
    """

    extent: tuple[float, float]

    def __new__(cls, index: int, width: float, height: float) -> "Texture":
        """Make a member from its index and extent."""
        member = int.__new__(cls, index)
        member._value_ = index
        member.extent = (width, height)
        return member


@dataclass(frozen=True)
class Paint:
    """Appearance of a surface: a texture, the colour that tints it, and the size of one image.

    Attributes:
        texture: index into the scene's textures.
        tint: RGB factor; 1 leaves the texture unchanged.
        extent: width and height in metres that one image covers.
        offset: texture coordinate of a panel's first corner, in images.
    """

    texture: int
    tint: Rgb = (1.0, 1.0, 1.0)
    extent: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


def paint(
    texture: Texture, tint: Rgb = (1.0, 1.0, 1.0), offset: tuple[float, float] = (0, 0)
) -> Paint:
    """A texture at its natural size."""
    return Paint(int(texture), tint, texture.extent, offset)


@dataclass(frozen=True)
class Mesh:
    """A mesh of T textured triangles.

    Attributes:
        triangles: float32 (T, 3, 3), corners in metres, counter-clockwise seen from outside.
        uv: float32 (T, 3, 2), texture coordinates of the corners.
        texture: int32 (T,), index into the scene's textures.
        tint: float32 (T, 3), RGB factor on the tinted parts of the texture.
        normals: float32 (T, 3), unit vectors used for shading (foliage tilts them).
    """

    triangles: Floats32
    uv: Floats32
    texture: NDArray[np.int32]
    tint: Floats32
    normals: Floats32

    def __len__(self) -> int:
        return len(self.triangles)

    def move(self, position: ArrayLike, yaw: float = 0.0) -> "Mesh":
        """The mesh rotated by ``yaw`` (radians, about z), then translated by ``position``."""
        c, s = np.cos(yaw), np.sin(yaw)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]], np.float32)
        triangles = self.triangles @ turn.T + np.asarray(position, np.float32)
        return replace(self, triangles=triangles, normals=self.normals @ turn.T)

    def multiply_tint(self, tint: ArrayLike) -> "Mesh":
        """The mesh with its tint multiplied by ``tint`` (RGB)."""
        return replace(self, tint=self.tint * np.asarray(tint, np.float32))

    def select(self, chosen: NDArray[np.bool_]) -> "Mesh":
        """The mesh of the chosen triangles, bool (T,)."""
        return Mesh(*(getattr(self, part.name)[chosen] for part in fields(self)))


def join_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Concatenate meshes into one, in order."""
    return Mesh(
        *(np.concatenate([getattr(mesh, part.name) for mesh in meshes]) for part in fields(Mesh))
    )


def triangles(corners: ArrayLike, uv: ArrayLike, paint: Paint) -> Mesh:
    """A mesh of triangles with one paint.

    Args:
        corners: (T, 3, 3), metres. Triangles without area are left out.
        uv: (T, 3, 2), texture coordinates.
        paint: texture and tint; its extent and offset are not applied.
    """
    points = np.asarray(corners, np.float32)
    cross = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    length = np.linalg.norm(cross, axis=1)
    keep = length > 1e-8
    count = int(keep.sum())
    return Mesh(
        points[keep],
        np.asarray(uv, np.float32)[keep],
        np.full(count, paint.texture, np.int32),
        np.tile(np.asarray(paint.tint, np.float32), (count, 1)),
        cross[keep] / length[keep, None],
    )


def panels(corners: ArrayLike, paint: Paint) -> Mesh:
    """Flat four-sided panels, (Q, 4, 3) in metres, counter-clockwise from the lower left corner."""
    quads = np.asarray(corners, np.float32)
    across, upward = quads[:, 1] - quads[:, 0], quads[:, 3] - quads[:, 0]
    width = np.linalg.norm(across, axis=1, keepdims=True)
    unit = across / np.maximum(width, 1e-6)
    height = np.linalg.norm(upward - unit * _dot(upward, unit), axis=1, keepdims=True)
    up = (upward - unit * _dot(upward, unit)) / np.maximum(height, 1e-6)
    relative = quads - quads[:, :1]
    metres = np.concatenate([_dot(relative, unit[:, None]), _dot(relative, up[:, None])], axis=-1)
    uv = (metres / np.asarray(paint.extent) + np.asarray(paint.offset)).astype(np.float32)
    return triangles(_split(quads), _split(uv), paint)


def level(low: ArrayLike, high: ArrayLike, z: float, paint: Paint, *, upward: bool = True) -> Mesh:
    """A level rectangle from (x, y) to (x, y) that faces up or down."""
    (x0, y0), (x1, y1) = np.asarray(low, float), np.asarray(high, float)
    corners = [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
    return panels([corners if upward else corners[::-1]], paint)


def box(low: ArrayLike, high: ArrayLike, paint: Paint, *, bottom: bool = False) -> Mesh:
    """A box between two opposite corners; by default without bottom, which is seldom seen."""
    faces = list(_BOX_FACES if bottom else _BOX_FACES[:5])
    return panels(_box_corners(low, high)[faces], paint)


def tapered_box(
    low: ArrayLike, high: ArrayLike, top_scale: tuple[float, float], paint: Paint
) -> Mesh:
    """A box without bottom whose top face is scaled by ``top_scale`` (x, y) about its centre."""
    corners = _box_corners(low, high)
    centre = corners[4:].mean(axis=0)
    corners[4:, :2] = centre[:2] + (corners[4:, :2] - centre[:2]) * np.asarray(top_scale)
    return panels(corners[list(_BOX_FACES[:5])], paint)


def tube(
    start: ArrayLike, end: ArrayLike, radii: tuple[float, float], paint: Paint, sides: int = 6
) -> Mesh:
    """The side of a cylinder or cone around the line from start to end."""
    first, last = np.asarray(start, np.float64), np.asarray(end, np.float64)
    axis = (last - first) / np.linalg.norm(last - first)
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    across = np.cross(axis, helper)
    across /= np.linalg.norm(across)
    angles = np.arange(sides + 1) * 2 * np.pi / sides
    ring = np.outer(np.cos(angles), across) + np.outer(np.sin(angles), np.cross(axis, across))
    low, high = first + radii[0] * ring, last + radii[1] * ring
    return panels(np.stack([low[:-1], low[1:], high[1:], high[:-1]], axis=1), paint)


def _box_corners(low: ArrayLike, high: ArrayLike) -> Floats32:
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, float), np.asarray(high, float)
    plan = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return np.array([(x, y, z) for z in (z0, z1) for x, y in plan], np.float32)


def _split(quads: Floats32) -> Floats32:
    """Split each four-sided panel into two triangles: (Q, 4, k) -> (2 Q, 3, k)."""
    return np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(
        -1, 3, quads.shape[-1]
    )


def _dot(a: Floats32, b: Floats32) -> Floats32:
    product: Floats32 = (a * b).sum(axis=-1, keepdims=True)
    return product


@dataclass(frozen=True)
class Side:
    """A line from ``start`` of ``length`` metres at ``yaw`` radians, the rectangle to its left.

    Positions are (along, inward): metres along the line, and into the rectangle.
    """

    start: tuple[float, float]
    yaw: float
    length: float

    def at(self, along: float, inward: float) -> tuple[float, float]:
        """x, y of a position, metres."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        x = self.start[0] + c * along - s * inward
        y = self.start[1] + s * along + c * inward
        return float(x), float(y)

    def along(self, x: float, y: float) -> tuple[float, float]:
        """(along, inward) of a point, metres."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        dx, dy = x - self.start[0], y - self.start[1]
        return float(c * dx + s * dy), float(c * dy - s * dx)
