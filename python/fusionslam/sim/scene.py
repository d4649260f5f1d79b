# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A scene of textured triangles and the ray caster that every simulated sensor shares."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats32
from fusionslam.errors import FusionSlamError
from fusionslam.sim.mesh import Mesh
from fusionslam.sim.mipmaps import MipMaps

# Rays coloured at a time: chunks that fit the processor's cache take a fifth less time.
_PIECE = 1 << 14
_LUMINANCE = np.array((0.299, 0.587, 0.114), np.float32)


@dataclass(frozen=True)
class Light:
    """Sun, sky and haze; colours are RGB factors, directions unit vectors, z up.

    An infinite ``visibility_m`` means no haze.
    """

    sun_direction: tuple[float, float, float] = (0.48, -0.42, 0.77)
    sun: tuple[float, float, float] = (0.78, 0.74, 0.66)
    ambient: tuple[float, float, float] = (0.36, 0.39, 0.44)
    horizon: tuple[float, float, float] = (0.80, 0.84, 0.88)
    zenith: tuple[float, float, float] = (0.36, 0.54, 0.82)
    visibility_m: float = 700.0


# Lamps all over the ceiling: no direction is dark, walls of different orientation differ in
# brightness, and a world without a ceiling shows an even grey above.
INDOOR_LIGHT = Light(
    sun_direction=(0.45, -0.28, 0.848),
    sun=(0.18, 0.175, 0.165),
    ambient=(0.87, 0.875, 0.885),
    horizon=(0.7, 0.7, 0.7),
    zenith=(0.7, 0.7, 0.7),
    visibility_m=np.inf,
)


@dataclass(frozen=True)
class Scene:
    """A static world: triangles, their textures, and the light.

    Attributes:
        mesh: all triangles.
        textures: uint8 (H, W, 4) each, RGB and tint; without textures the tints are the colours.
        light: sun, sky and haze.
        part: int32 (T,), the object that each triangle belongs to; empty if unknown.
        names: names of the objects.
        ground: bool, one per object: True if a robot can drive on it.
    """

    mesh: Mesh
    textures: Sequence[NDArray[np.uint8]]
    light: Light = field(default_factory=Light)
    part: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    names: Sequence[str] = ()
    ground: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))


@dataclass(frozen=True)
class Hits:
    """First intersections of R rays with the scene.

    Attributes:
        distance: float32 (R,), in lengths of the ray's direction; infinite for a miss.
        triangle: int32 (R,), -1 for a miss.
        u, v: float32 (R,), barycentric coordinates of the second and third corner.
    """

    distance: Floats32
    triangle: NDArray[np.int32]
    u: Floats32
    v: Floats32

    def __getitem__(self, chosen: slice | NDArray[np.intp]) -> "Hits":
        return Hits(self.distance[chosen], self.triangle[chosen], self.u[chosen], self.v[chosen])


class RayCaster:
    """Casts rays into one scene. Safe to share between threads once constructed."""

    def __init__(self, scene: Scene) -> None:
        self._mesh = scene.mesh
        self._part = scene.part
        self._light = scene.light
        self._maps = MipMaps(scene.textures)
        self._texel_m = _texel_sizes(scene.mesh, self._maps)
        self._lit = _lit_sides(scene.mesh, scene.light)
        a, b, c = scene.mesh.triangles.transpose(1, 0, 2)
        cross = np.cross(b - a, c - a)
        length = np.linalg.norm(cross, axis=1, keepdims=True)
        self._flat: Floats32 = cross / np.maximum(length, 1e-12)
        self._embree = _embree_scene(scene.mesh)
        # The first query builds the tree; later ones only read it, from any thread.
        self.cast(np.zeros(3, np.float32), np.array([[0, 0, 1]], np.float32))

    def cast(self, origin: Floats32, directions: Floats32) -> Hits:
        """First hits of rays from ``origin`` (3,), metres, along ``directions`` (R, 3)."""
        rays = np.ascontiguousarray(directions, np.float32)
        starts = np.ascontiguousarray(np.broadcast_to(origin, rays.shape), np.float32)
        found = self._embree.run(starts, rays, query="INTERSECT", output=True)
        distance = np.where(found["geomID"] < 0, np.float32(np.inf), found["tfar"])
        triangle = np.where(found["geomID"] < 0, np.int32(-1), found["primID"])
        return Hits(distance, triangle, found["u"], found["v"])

    def under(self, light: Light) -> "RayCaster":
        """The same triangles in another light, without a tree of its own."""
        other = copy.copy(self)
        other._light = light
        other._lit = _lit_sides(self._mesh, light)
        return other

    def part_of(self, hits: Hits) -> NDArray[np.int32]:
        """The object that each ray hits, int32 (R,), an index into ``Scene.names``.

        -1 for a miss, and for all rays if the scene has no objects listed.
        """
        if not len(self._part):
            return np.full(len(hits.triangle), -1, np.int32)
        return np.where(hits.triangle < 0, np.int32(-1), self._part[hits.triangle])

    def incidence(self, hits: Hits, directions: Floats32) -> Floats32:
        """Cosine between ray and surface normal, (R,): negative if the ray hits the front side."""
        length = np.sqrt(np.einsum("ij,ij->i", directions, directions))
        cosine: Floats32 = np.einsum("ij,ij->i", self._flat[hits.triangle], directions) / length
        return cosine

    def brightness(self, hits: Hits) -> Floats32:
        """Grey value of the unlit surface at each hit, (R,), 0 .. 1, as a LiDAR measures it."""
        u, v = self._texture_coordinates(hits)
        texture = self._mesh.texture[hits.triangle]
        texels = self._maps.sample(texture, u, v, np.zeros(len(u), np.float32))
        rgb = self._albedo(texels, hits.triangle)
        grey: Floats32 = np.einsum("ij,j->i", rgb, _LUMINANCE)
        return grey

    def colors(self, hits: Hits, directions: Floats32, pixel: float) -> Floats32:
        """RGB that a camera sees along each ray, float32 (R, 3), 0 .. 1 (more in glare).

        Args:
            hits: result of ``cast`` for the same directions.
            directions: float32 (R, 3), the rays; z is 1 in the camera frame for all of them.
            pixel: width of a pixel at distance 1, metres.
        """
        rgb = np.empty(directions.shape, np.float32)
        for start in range(0, len(rgb), _PIECE):
            part = slice(start, start + _PIECE)
            rgb[part] = self._colors(hits[part], directions[part], pixel)
        return rgb

    def _colors(self, hits: Hits, directions: Floats32, pixel: float) -> Floats32:
        missed = np.flatnonzero(hits.triangle < 0)
        if not len(missed):  # nearly always indoors; skips selecting the rays that hit
            return self._surface(hits, directions, pixel)
        seen = np.flatnonzero(hits.triangle >= 0)
        rgb = np.empty(directions.shape, np.float32)
        rgb[missed] = self._sky(directions[missed])
        rgb[seen] = self._surface(hits[seen], directions[seen], pixel)
        return rgb

    def _surface(self, hits: Hits, directions: Floats32, pixel: float) -> Floats32:
        u, v = self._texture_coordinates(hits)
        texture = self._mesh.texture[hits.triangle]
        cosine = self.incidence(hits, directions)
        # The footprint is stretched by 1 / cosine along one axis only: its geometric mean blurs
        # and aliases equally little.
        footprint = pixel * hits.distance / np.sqrt(np.abs(cosine).clip(min=0.02))
        level: Floats32 = np.log2(footprint / self._texel_m[hits.triangle])
        albedo = self._albedo(self._maps.sample(texture, u, v, level), hits.triangle)
        lit: Floats32 = albedo * self._lit[(cosine > 0).astype(np.intp), hits.triangle]
        if np.isinf(self._light.visibility_m):
            return lit
        sky = self._sky(directions)
        clear = np.exp(hits.distance * np.float32(-1 / self._light.visibility_m))[:, None]
        blended: Floats32 = sky + clear * (lit - sky)
        return blended

    def _texture_coordinates(self, hits: Hits) -> tuple[Floats32, Floats32]:
        uv = self._mesh.uv[hits.triangle]
        weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], axis=1)
        at = np.einsum("ij,ijk->ik", weights, uv)
        return at[:, 0], at[:, 1]

    def _albedo(self, texels: Floats32, triangle: NDArray[np.int32]) -> Floats32:
        tint = self._mesh.tint[triangle]
        albedo: Floats32 = texels[:, :3] * (1 + texels[:, 3:] * (tint - 1))
        return albedo

    def _sky(self, directions: Floats32) -> Floats32:
        low, high = (np.asarray(c, np.float32) for c in (self._light.horizon, self._light.zenith))
        length = np.linalg.norm(directions, axis=1)
        height = np.clip(directions[:, 2] / length * 2.0, 0, 1)[:, None]
        sky: Floats32 = low + height * (high - low)
        return sky


def _embree_scene(mesh: Mesh) -> Any:
    # A heavy import: reading a configuration must not load the ray tracer.
    try:
        from embreex.mesh_construction import TriangleMesh  # type: ignore[import-untyped]
        from embreex.rtcore_scene import EmbreeScene  # type: ignore[import-untyped]
    except ImportError as error:
        raise FusionSlamError("the simulator needs: pip install 'fusionslam[sim]'") from error
    scene = EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(mesh.triangles))
    return scene


def _lit_sides(mesh: Mesh, light: Light) -> Floats32:
    """RGB light on the front and the back of each triangle, (2, T, 3)."""
    return np.stack([_lit(mesh.normals, light, side) for side in (1.0, -1.0)])


def _lit(normals: Floats32, light: Light, side: float) -> Floats32:
    """RGB light on each triangle, (T, 3), seen from its front (side 1) or back (side -1)."""
    facing = side * normals
    sun = np.maximum(facing @ np.asarray(light.sun_direction, np.float32), 0)[:, None]
    sky = (0.75 + 0.25 * facing[:, 2])[:, None]
    lit: Floats32 = sun * np.asarray(light.sun, np.float32) + sky * np.asarray(
        light.ambient, np.float32
    )
    return lit


def _texel_sizes(mesh: Mesh, maps: MipMaps) -> Floats32:
    """Metres per texel at the finest level, (T,)."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    p, q, r = mesh.uv.transpose(1, 0, 2)
    images = np.abs((q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0])
    texels = images * maps.texels[mesh.texture]
    size: Floats32 = np.sqrt(area / np.maximum(texels, 1e-9)).astype(np.float32)
    return np.maximum(size, np.float32(1e-6))
