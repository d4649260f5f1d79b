# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Houses of a few types, repeated as in real streets. They stand at y >= 0 and face -y."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusionslam.sim.mesh import Mesh, Paint, Rgb, box, join_meshes, paint, panels
from fusionslam.sim.town.textures import FACADES, FLOOR_M, Look

WALL_TINTS: tuple[Rgb, ...] = (
    (0.72, 0.36, 0.28),
    (0.86, 0.62, 0.38),
    (0.95, 0.88, 0.66),
    (0.66, 0.74, 0.84),
    (0.72, 0.84, 0.68),
    (0.93, 0.91, 0.88),
    (0.86, 0.60, 0.56),
    (0.58, 0.48, 0.42),
    (0.98, 0.80, 0.42),
    (0.60, 0.63, 0.66),
)
ROOF_TINTS: tuple[Rgb, ...] = (
    (0.78, 0.36, 0.26),
    (0.55, 0.30, 0.24),
    (0.42, 0.42, 0.46),
    (0.50, 0.42, 0.36),
)
DOOR_TINTS: tuple[Rgb, ...] = (
    (0.45, 0.12, 0.10),
    (0.12, 0.28, 0.20),
    (0.15, 0.22, 0.42),
    (0.42, 0.28, 0.16),
    (0.85, 0.85, 0.82),
)
_BASE = paint(Look.PLASTER, (0.55, 0.54, 0.52))


@dataclass(frozen=True)
class HouseType:
    """Properties shared by all houses of one type; lengths in metres."""

    facade: int
    wall: Rgb
    width: float
    depth: float
    floors: int
    roof: str
    roof_height: float
    roof_tint: Rgb
    door: Rgb


def house_type(rng: np.random.Generator, kind: str, wall: Rgb) -> HouseType:
    """Draw a random type of ``kind`` ("row", "villa" or "flats") with walls of one colour."""
    facade = int(rng.integers(len(FACADES)))
    bay = FACADES[facade].bay_m
    widths = {"row": (6, 10), "villa": (8, 13), "flats": (16, 24)}[kind]
    floors = {"row": (2, 4), "villa": (1, 2), "flats": (4, 6)}[kind]
    flat = kind == "flats" or rng.random() < 0.15
    return HouseType(
        facade=facade,
        wall=wall,
        width=bay * round(rng.uniform(*widths) / bay),
        depth=bay * max(1, round(rng.uniform(8, 11) / bay)),
        floors=int(rng.integers(floors[0], floors[1] + 1)),
        roof="flat" if flat else str(rng.choice(["gable", "side gable", "hip"])),
        roof_height=float(rng.uniform(2.2, 4.2)),
        roof_tint=ROOF_TINTS[rng.integers(len(ROOF_TINTS))],
        door=DOOR_TINTS[rng.integers(len(DOOR_TINTS))],
    )


def house(kind: HouseType, rng: np.random.Generator) -> Mesh:
    """Build a house: left front corner at the origin, front along the x axis, facing -y."""
    parts = [_walls(kind, rng), _roof(kind), _door(kind, rng)]
    width, depth, z = kind.width, kind.depth, kind.floors * FLOOR_M
    if kind.roof != "flat":  # a chimney
        x, y = rng.uniform(0.2, 0.8) * width, rng.uniform(0.35, 0.65) * depth
        high = (x + 0.35, y + 0.35, z + kind.roof_height + 0.8)
        cover = paint(Look.PLASTER, (0.6, 0.4, 0.34))
        parts.append(box((x - 0.35, y - 0.35, z), high, cover))
    elif kind.floors > 3:  # the top of a lift
        high, cover = (width * 0.4 + 3, depth * 0.8, z + 3), paint(Look.PLASTER, (0.7, 0.7, 0.7))
        parts.append(box((width * 0.4, depth * 0.4, z), high, cover))
    shade = 1 + 0.10 * rng.uniform(-1, 1)
    return join_meshes(parts).multiply_tint((shade, shade, shade))


def _walls(kind: HouseType, rng: np.random.Generator) -> Mesh:
    bay = FACADES[kind.facade].bay_m
    offset = (rng.integers(4) * bay / 12.0, rng.integers(4) / 4.0)
    cover = Paint(Look.FACADE + kind.facade, kind.wall, Look.FACADE.extent, offset)
    sides = box((0, 0, 0), (kind.width, kind.depth, kind.floors * FLOOR_M), cover)
    base = box((-0.06, -0.06, 0), (kind.width + 0.06, kind.depth + 0.06, 0.5), _BASE)
    return join_meshes([sides, base])


def _roof(kind: HouseType) -> Mesh:
    w, d, z = kind.width, kind.depth, kind.floors * FLOOR_M
    if kind.roof == "flat":
        rim = paint(Look.PLASTER, (0.62, 0.62, 0.62))
        return box((-0.12, -0.12, z - 0.3), (w + 0.12, d + 0.12, z + 0.5), rim)
    top, eave = z + kind.roof_height, 0.45
    if kind.roof == "side gable":
        return _gable(np.array([[0, 0], [w, 0], [w, d], [0, d]]), z, top, eave, kind)
    if kind.roof == "gable":
        return _gable(np.array([[w, 0], [w, d], [0, d], [0, 0]]), z, top, eave, kind)
    ridge = min(w, d) * 0.35
    a, b, c, e = (
        (-eave, -eave, z),
        (w + eave, -eave, z),
        (w + eave, d + eave, z),
        (-eave, d + eave, z),
    )
    left, right = (ridge, d / 2, top), (w - ridge, d / 2, top)
    slopes = [(a, b, right, left), (c, e, left, right), (b, c, right, right), (e, a, left, left)]
    return panels(slopes, paint(Look.ROOF, kind.roof_tint))


def _gable(
    plan: NDArray[np.int64] | NDArray[np.float64],
    z: float,
    top: float,
    eave: float,
    kind: HouseType,
) -> Mesh:
    """A gable roof: slopes over the plan's first and third edge, plastered gables at the others."""
    a, b, c, d = (np.array([x, y, z]) for x, y in plan)
    side, out = (b - a) / np.linalg.norm(b - a), (a - d) / np.linalg.norm(a - d)
    up = np.array([0, 0, top - z])
    first, last = (a + d) / 2 + up, (b + c) / 2 + up
    # Eaves continue the slope outwards, and so downwards.
    drop = out * eave - up * eave / (np.linalg.norm(a - d) / 2)
    rise = -out * eave - up * eave / (np.linalg.norm(a - d) / 2)
    over = side * eave
    slopes = [
        (a + drop - over, b + drop + over, last + over, first - over),
        (c + rise + over, d + rise - over, first - over, last + over),
    ]
    ends = [(d, a, first, first), (b, c, last, last)]
    gables = panels(np.array(ends), paint(Look.PLASTER, kind.wall))
    return join_meshes([panels(np.array(slopes), paint(Look.ROOF, kind.roof_tint)), gables])


def _door(kind: HouseType, rng: np.random.Generator) -> Mesh:
    bay = FACADES[kind.facade].bay_m
    place = bay * int(rng.integers(max(1, round(kind.width / bay))))
    left = place + bay / 2 - 0.6
    step = box((left - 0.3, -0.9, 0), (left + 1.5, 0, 0.18), _BASE)
    leaf = box((left, -0.12, 0.18), (left + 1.2, 0, 2.4), paint(Look.DOOR, kind.door))
    canopy = box((left - 0.3, -0.9, 2.6), (left + 1.5, 0, 2.75), paint(Look.ROOF, kind.roof_tint))
    return join_meshes([step, leaf, canopy])
