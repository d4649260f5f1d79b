# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Things that move through a world, and the world with them in it.

Each has a small ray caster in its own frame, built once: rays are taken there by its pose at each
ray's own time. So the world's large one stays as it is, and no moment of a sweep is approximated.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats, Floats32, Mask
from fusionslam.geometry.trajectory import ground_poses
from fusionslam.sim.mesh import Mesh
from fusionslam.sim.motion.giving_way import Track
from fusionslam.sim.scene import Hits, Light, RayCaster, Scene

Rows = NDArray[np.intp]
# Rays are single precision: that much wider is the sphere that they have to meet.
_MARGIN = 1.02


@dataclass(frozen=True, eq=False)
class Mover:
    """A rigid thing and where it is over time.

    Attributes:
        mesh: in its own frame: its middle on the z axis, on the ground, x ahead.
        textures: uint8 (H, W, 4) each, which the mesh refers to.
        seconds: float64 (T,), times, on the clock of the robot's trajectory.
        track: where it is at these times, and others must not be.
        height: float64 (T,) or a number, of the ground below it, metres.
    """

    mesh: Mesh
    textures: Sequence[NDArray[np.uint8]]
    seconds: Floats
    track: Track
    height: Floats | float = 0.0

    def poses(self, seconds: Floats) -> Floats:
        """world_from_mover, (M, 4, 4), linear between times.

        It stands still before the first time and after the last.
        """
        height = np.broadcast_to(self.height, self.seconds.shape)
        values = (*self.track.places.T, self.track.yaw, height)
        x, y, yaw, z = (np.interp(seconds, self.seconds, value) for value in values)
        poses = ground_poses(x, y, yaw)
        poses[:, 2, 3] = z
        return poses


class Body:
    """What rays meet of a mover, in its own frame.

    Args:
        mesh: its triangles.
        textures: of the mesh.
        light: of the world.
    """

    def __init__(self, mesh: Mesh, textures: Sequence[NDArray[np.uint8]], light: Light) -> None:
        self.caster = RayCaster(Scene(mesh, textures, light))
        self.count = len(mesh)
        self._light = light
        corners = mesh.triangles.reshape(-1, 3).astype(np.float64)
        self._middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        self._radius_m = _MARGIN * np.linalg.norm(corners - self._middle, axis=1).max()

    def near(self, poses: Floats, origin: Floats32, directions: Floats32) -> Rows:
        """Rows of the rays that meet the sphere around it."""
        middles = (poses[:, :3, :3] @ self._middle + poses[:, :3, 3]).astype(np.float32)
        if len(middles) > 1:
            middles = np.tile(middles, (len(directions) // len(middles), 1))
        away = middles - origin
        along = np.einsum("ij,ij->i", directions, np.broadcast_to(away, directions.shape))
        squared = np.einsum("ij,ij->i", directions, directions)
        beside = (away**2).sum(axis=-1) - self._radius_m**2
        return np.flatnonzero((beside < 0) | ((along > 0) & (beside * squared < along**2)))

    def lit(self, pose: Floats) -> RayCaster:
        """The caster under the world's light, as it falls on the mover in this pose."""
        sun = tuple((np.asarray(self._light.sun_direction) @ pose[:3, :3]).tolist())
        return self.caster.under(replace(self._light, sun_direction=sun))


class _Share(NamedTuple):
    """The hits of one caster.

    Attributes:
        caster: into whose scene the rays were cast.
        rows: of the hits among all.
        hits: with the caster's own numbers.
        turns: float64 (C, 3, 3), world_from_caster of each column; None for the world itself.
    """

    caster: RayCaster
    rows: slice | Rows
    hits: Hits
    turns: Floats | None = None

    def turned(self, directions: Floats32) -> Floats32:
        """The directions of its rays in its own frame, (R, 3)."""
        if self.turns is None or isinstance(self.rows, slice):
            return directions[self.rows]
        turns = self.turns[self.rows % len(self.turns)]
        return np.asarray(np.einsum("nji,nj->ni", turns, directions[self.rows]), np.float32)


class Crowd:
    """A static world with movers in it; a ``Caster``. Triangles and objects are numbered after
    those of the world.

    Args:
        rest: the world.
        scene: of the world.
        bodies: of the movers.
        poses: float64 (C, 4, 4) for each body, world_from_body; C is 1, or the number of a sweep's
            columns, which are measured one after the other.
    """

    def __init__(
        self,
        rest: RayCaster,
        scene: Scene,
        bodies: Sequence[Body] = (),
        poses: Sequence[Floats] = (),
    ) -> None:
        self._rest, self._bodies, self._poses = rest, bodies, poses
        self._names = len(scene.names)
        self._firsts = np.cumsum([len(scene.mesh), *(body.count for body in bodies)])

    def cast(self, origin: Floats32, directions: Floats32) -> Hits:
        """First hits of rays from ``origin`` (3,) or (R, 3) along ``directions`` (R, 3)."""
        found = self._rest.cast(origin, directions)
        for body, poses, first in zip(self._bodies, self._poses, self._firsts, strict=False):
            rows = body.near(poses, origin, directions)
            if not len(rows):
                continue
            pose = poses[rows % len(poses)]
            starts = np.broadcast_to(origin, directions.shape)[rows] - pose[:, :3, 3]
            hits = body.caster.cast(
                np.einsum("nji,nj->ni", pose[:, :3, :3], starts).astype(np.float32),
                np.einsum("nji,nj->ni", pose[:, :3, :3], directions[rows]).astype(np.float32),
            )
            near = hits.distance < found.distance[rows]
            at = rows[near]
            found.distance[at] = hits.distance[near]
            found.triangle[at] = hits.triangle[near] + np.int32(first)
            found.u[at], found.v[at] = hits.u[near], hits.v[near]
        return found

    def incidence(self, hits: Hits, directions: Floats32) -> Floats32:
        """Cosine between ray and surface normal, (R,)."""
        return self._join(
            hits, lambda number, own: own.caster.incidence(own.hits, own.turned(directions))
        )

    def brightness(self, hits: Hits) -> Floats32:
        """Grey value of the surface at each hit, (R,)."""
        return self._join(hits, lambda number, own: own.caster.brightness(own.hits))

    def colors(self, hits: Hits, directions: Floats32, pixel: float) -> Floats32:
        """RGB that a camera sees along each ray, (R, 3)."""

        def seen(number: int, own: _Share) -> Floats32:
            lit = self._bodies[number - 1].lit(self._poses[number - 1][0]) if number else self._rest
            return lit.colors(own.hits, own.turned(directions), pixel)

        return self._join(hits, seen)

    def objects(self, hits: Hits) -> NDArray[np.uint16]:
        """Number of the object at each hit, counted from 1, movers last; 0 if unknown."""
        number = np.zeros(len(hits.triangle), np.uint16)
        for owner, own in self._split(hits):
            number[own.rows] = self._names + owner if owner else self._rest.part_of(own.hits) + 1
        return number

    def moving(self, hits: Hits) -> Mask:
        """Whether each hit is on a mover, bool (R,)."""
        return np.asarray(hits.triangle >= self._firsts[0])

    def _join(self, hits: Hits, values_of: Callable[[int, _Share], Floats32]) -> Floats32:
        """Values of each hit, by the caster that it belongs to."""
        shares = self._split(hits)
        parts = [values_of(*share) for share in shares]
        joined = np.empty((len(hits.distance), *parts[0].shape[1:]), np.float32)
        for (_, share), part in zip(shares, parts, strict=True):
            joined[share.rows] = part
        return joined

    def _split(self, hits: Hits) -> list[tuple[int, _Share]]:
        """The hits on the static world (0), and on each mover that was hit, from 1."""
        if not self.moving(hits).any():
            return [(0, _Share(self._rest, slice(None), hits))]
        owners = np.searchsorted(self._firsts, hits.triangle, side="right")
        rest = np.flatnonzero(owners == 0)
        shares = [(0, _Share(self._rest, rest, hits[rest]))]
        for owner in np.unique(owners[owners > 0]).tolist():
            rows = np.flatnonzero(owners == owner)
            own = hits[rows]
            own = replace(own, triangle=own.triangle - np.int32(self._firsts[owner - 1]))
            turns = self._poses[owner - 1][:, :3, :3]
            shares.append((owner, _Share(self._bodies[owner - 1].caster, rows, own, turns)))
        return shares
