# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Objects that stand in rooms, each with a visual and a collision shape.

An object is centred on the origin: z = 0 is the floor, its front faces -y.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fusionslam.sim.indoor.textures import Look, indoor_textures
from fusionslam.sim.mesh import Mesh, Paint, box, join_meshes, paint, panels, tube
from fusionslam.sim.motion.occupancy import occupancy_of
from fusionslam.sim.scene import INDOOR_LIGHT
from fusionslam.sim.world import Part, World, scene_of

_SOLID = paint(Look.PLAIN)


@dataclass(frozen=True)
class Thing:
    """One kind of object.

    Attributes:
        kind: its name without a number, such as "chair".
        visual: shape that cameras see.
        collision: shape that simple ray sensors hit; None for flat things such as posters.
        size: x, y of its footprint, metres, centred on the origin.
        is_ground: True if a robot may drive over it.
    """

    kind: str
    visual: Mesh
    collision: Mesh | None
    size: tuple[float, float]
    is_ground: bool = False


class Site:
    """Collects the parts of a world that is being built."""

    def __init__(self) -> None:
        self._visual: list[Part] = []
        self._collision: list[Part] = []
        self._counts: Counter[str] = Counter()

    def put(self, thing: Thing, x: float, y: float, yaw: float = 0.0, z: float = 0.0) -> str:
        """Place a thing, metres and radians; return its name, which is its kind and a number."""
        self._counts[thing.kind] += 1
        name = f"{thing.kind}_{self._counts[thing.kind]}"
        place = (x, y, z)
        self._visual.append(Part(name, thing.visual.move(place, yaw), thing.is_ground))
        if thing.collision is not None:
            mesh = thing.collision.move(place, yaw)
            self._collision.append(Part(name, mesh, thing.is_ground))
        return name

    def world(self, name: str, seed: int, start: tuple[float, float]) -> World:
        """Build the world from everything placed so far.

        Args:
            name: the world's name.
            seed: decides the textures.
            start: x, y of a free point, metres; the map's reachable part contains it.
        """
        textures = indoor_textures(seed)
        visual = scene_of(self._visual, textures, INDOOR_LIGHT)
        collision = scene_of(self._collision, textures, INDOOR_LIGHT)
        room = occupancy_of(collision, start=start)
        return World(name=name, visual=visual, collision=collision, map=room)


def thing(kind: str, shapes: Sequence[Mesh], solid: Sequence[Mesh]) -> Thing:
    """A thing made of visual and collision shapes."""
    visual, collision = join_meshes(shapes), join_meshes(solid)
    return Thing(kind, visual, collision, _footprint(join_meshes([visual, collision])))


def flat(kind: str, shapes: Sequence[Mesh], *, is_ground: bool = False) -> Thing:
    """A thing that rays of simple sensors do not hit, such as a poster or a carpet."""
    visual = join_meshes(shapes)
    return Thing(kind, visual, None, _footprint(visual), is_ground)


def block(low: ArrayLike, high: ArrayLike, cover: Paint = _SOLID) -> Mesh:
    """A box with a bottom, for things that stand on legs; unpainted for collision shapes."""
    return box(low, high, cover, bottom=True)


def legs(width: float, depth: float, height: float, thick: float, cover: Paint = _SOLID) -> Mesh:
    """Four square legs at the corners of a footprint centred on the origin."""
    x, y = width / 2, depth / 2
    corners = [(-x, -y), (x - thick, -y), (-x, y - thick), (x - thick, y - thick)]
    return join_meshes([box((u, v, 0), (u + thick, v + thick, height), cover) for u, v in corners])


def cylinder(
    base: tuple[float, float, float],
    height: float,
    radii: tuple[float, float],
    cover: Paint = _SOLID,
    sides: int = 10,
) -> Mesh:
    """An upright cylinder or cone (radii at bottom and top) with a top face."""
    x, y, z = base
    side = tube(base, (x, y, z + height), radii, cover, sides)
    lid = tube((x, y, z + height), (x, y, z + height + 1e-3), (radii[1], 1e-4), cover, sides)
    return join_meshes([side, lid])


def wheel(x: float, y: float, radius: float, width: float, cover: Paint, *, along: int = 0) -> Mesh:
    """A wheel with closed sides on the floor that rolls along x (``along`` 0) or y (1)."""
    axle = np.array(((0.0, width / 2, 0.0), (width / 2, 0.0, 0.0))[along])
    middle = np.array((x, y, radius))
    low, high = middle - axle, middle + axle
    tread = tube(low, high, (radius, radius), cover, 10)
    caps = [
        tube(end, end + 0.02 * axle * way, (radius, 1e-4), cover, 10)
        for end, way in ((low, -1), (high, 1))
    ]
    return join_meshes([tread, *caps])


def front(low: tuple[float, float], high: tuple[float, float], y: float, cover: Paint) -> Mesh:
    """An upright panel that faces -y, from (x, z) to (x, z), at ``y``."""
    (x0, z0), (x1, z1) = low, high
    return panels([[(x0, y, z0), (x1, y, z0), (x1, y, z1), (x0, y, z1)]], cover)


def _footprint(mesh: Mesh) -> tuple[float, float]:
    reach = 2 * np.abs(mesh.triangles[..., :2]).max(axis=(0, 1))
    return float(reach[0]), float(reach[1])
