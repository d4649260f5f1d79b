# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A world that robots drive through: visual and collision shapes, and a map of free space."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.arrays import Floats
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.mesh import Mesh, join_meshes
from fusionslam.sim.motion.occupancy import OccupancyMap
from fusionslam.sim.scene import Light, Scene


@dataclass(frozen=True)
class Part:
    """One object of a world.

    Attributes:
        name: not necessarily unique; "shelf_3".
        mesh: its triangles in the world's frame.
        is_ground: True if a robot can drive on it: floors, carpets, roads.
    """

    name: str
    mesh: Mesh
    is_ground: bool = False


@dataclass(frozen=True, kw_only=True)
class World:
    """A world in metres, z up, with flat ground at z = 0.

    Attributes:
        name: for display and file names.
        visual: shapes that cameras see.
        collision: shapes that simple ray sensors hit; ``visual`` if there are no others.
        map: free space for a robot; None if it has yet to be computed.
        trajectory: a drive that comes with the world, if there is one.
        lanes: float64 (N, 2) each, closed ways for cars in the direction of traffic, metres.
        unresolved: resources that the description refers to and that could not be found.
    """

    name: str
    visual: Scene
    collision: Scene
    map: OccupancyMap | None = None
    trajectory: Trajectory | None = None
    lanes: Sequence[Floats] = ()
    unresolved: Sequence[str] = field(default_factory=tuple)


def scene_of(
    parts: Sequence[Part],
    textures: Sequence[NDArray[np.uint8]],
    light: Light | None = None,
) -> Scene:
    """A scene of parts, in which each triangle records the part it belongs to.

    Args:
        parts: in any order; ``Scene.part`` indexes them.
        textures: uint8 (H, W, 4) each, RGB and tint; the meshes' texture indices refer to them.
        light: the default is that of the town.
    """
    counts = [len(part.mesh) for part in parts]
    return Scene(
        join_meshes([part.mesh for part in parts]),
        textures,
        light or Light(),
        part=np.repeat(np.arange(len(parts), dtype=np.int32), counts),
        names=tuple(part.name for part in parts),
        ground=np.array([part.is_ground for part in parts], dtype=bool),
    )


def hash_world(world: World) -> str:
    """Hash of all that a recording depends on, whichever files it was read from."""
    digest = hashlib.sha256()
    for scene in (world.visual, world.collision):
        mesh = scene.mesh
        arrays = [mesh.triangles, mesh.uv, mesh.texture, mesh.tint, mesh.normals, scene.part]
        for array in (*arrays, scene.ground, *scene.textures):
            digest.update(f"{array.shape}".encode() + np.ascontiguousarray(array).tobytes())
        digest.update(f"{scene.names} {scene.light}".encode())
    if world.map is not None:
        digest.update(f"{world.map.resolution_m} {world.map.origin}".encode())
        digest.update(world.map.occupied.tobytes() + world.map.reachable.tobytes())
    if (drive := world.trajectory) is not None:
        digest.update(np.stack([drive.seconds, drive.x, drive.y, drive.yaw]).tobytes())
    for lane in world.lanes:
        digest.update(lane.tobytes())
    return digest.hexdigest()
