# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A world that robots drive through: what cameras see, what rays hit, and where there is room."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fusionslam.geometry.trajectory import Trajectory
from fusionslam.sim.mesh import Mesh, joined
from fusionslam.sim.motion.occupancy import OccupancyMap
from fusionslam.sim.scene import Light, Scene


@dataclass(frozen=True)
class Part:
    """One object of a world.

    Attributes:
        name: unique or not; "shelf_3".
        mesh: its triangles in the world's frame.
        is_ground: whether a robot could drive on it: floors, carpets, roads.
    """

    name: str
    mesh: Mesh
    is_ground: bool = False


@dataclass(frozen=True, kw_only=True)
class World:
    """Metres, z up, the ground at z = 0 as far as it is flat.

    Attributes:
        name: for people and file names.
        visual: what cameras see.
        collision: what simple ray sensors hit; the same as ``visual`` where nothing else is known.
        map: where there is room for a robot; None if it has yet to be made.
        trajectory: a drive that belongs to the world, if there is one.
        unresolved: what the description names and could not be found.
    """

    name: str
    visual: Scene
    collision: Scene
    map: OccupancyMap | None = None
    trajectory: Trajectory | None = None
    unresolved: Sequence[str] = field(default_factory=tuple)


def scene_of(
    parts: Sequence[Part],
    textures: Sequence[NDArray[np.uint8]],
    light: Light | None = None,
) -> Scene:
    """A scene whose triangles remember the part they belong to.

    Args:
        parts: in any order; ``Scene.part`` counts them.
        textures: uint8 (H, W, 4) each, RGB and tint, which the meshes' texture indices mean.
        light: the default is that of the town.
    """
    counts = [len(part.mesh) for part in parts]
    return Scene(
        joined([part.mesh for part in parts]),
        textures,
        light or Light(),
        part=np.repeat(np.arange(len(parts), dtype=np.int32), counts),
        names=tuple(part.name for part in parts),
        ground=np.array([part.is_ground for part in parts], dtype=bool),
    )
