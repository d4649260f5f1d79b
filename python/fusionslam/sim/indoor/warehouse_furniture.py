# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Warehouse furniture: racks and their loads, pallets, drums, a fork-lift, benches."""

from collections.abc import Callable

import numpy as np

from fusionslam.sim.indoor.furniture import CLOTHS, make_piece
from fusionslam.sim.indoor.objects import Thing, block, cylinder, flat, front, thing, wheel
from fusionslam.sim.indoor.textures import BLUE, DARK, GREY, TIMBER, Look, cut, fit
from fusionslam.sim.mesh import Mesh, Rgb, box, paint, panels, tube

BAY_M = 2.7
DEPTH_M = 1.1
_LEVELS_M = (0.12, 1.35, 2.45)
_CARDBOARD: tuple[Rgb, ...] = ((1.0, 1.0, 1.0), (0.9, 0.86, 0.8), (1.15, 1.12, 1.05))

Shapes = tuple[list[Mesh], list[Mesh]]


def rack_bay(rng: np.random.Generator, fill: float) -> Thing:
    """One bay of a pallet rack along x, open to both sides, with loads on three levels."""
    frame = make_piece("rack_frame")
    assert frame.collision is not None
    visual, solid = [frame.visual], [frame.collision]
    for z in _LEVELS_M:
        for x in (-0.86, 0.0, 0.86):
            if rng.random() < fill:
                seen, hit = _load(rng, 0.8, 1.0, 0.85)
                visual += [mesh.move((x, 0, z)) for mesh in seen]
                solid += [mesh.move((x, 0, z)) for mesh in hit]
    return thing("shelf", visual, solid)


def _load(rng: np.random.Generator, width: float, depth: float, height: float) -> Shapes:
    """A pallet with cartons, crates or drums, centred on the origin."""
    makers: tuple[Callable[..., Shapes], ...] = (_cartons, _cartons, _one_carton, _crates, _drums)
    seen, hit = makers[rng.integers(len(makers))](rng, width, depth, height - 0.14)
    low, high = _pallet(width, depth)
    return (
        [*low, *(mesh.move((0, 0, 0.14)) for mesh in seen)],
        [*high, *(mesh.move((0, 0, 0.14)) for mesh in hit)],
    )


def _pallet(width: float, depth: float) -> Shapes:
    """A pallet: three runners with blocks under a deck of boards."""
    wood, x, y = paint(Look.WOOD, TIMBER), width / 2, depth / 2
    runners = [
        block((u - 0.05, -y, 0.0), (u + 0.05, y, 0.115), wood) for u in (-x + 0.05, 0.0, x - 0.05)
    ]
    deck = [
        block((-x, v, 0.115), (x, v + 0.115, 0.14), wood) for v in np.linspace(-y, y - 0.115, 5)
    ]
    return [*runners, *deck], [*runners, block((-x, -y, 0.115), (x, y, 0.14))]


def _cartons(rng: np.random.Generator, width: float, depth: float, height: float) -> Shapes:
    """Layers of two by two cartons, the top layer incomplete."""
    layers = int(rng.integers(1, 3))
    rise = 0.30
    tint = _CARDBOARD[rng.integers(len(_CARDBOARD))]
    shapes = []
    for layer, row, column in np.ndindex(layers, 2, 2):
        if layer == layers - 1 and rng.random() < 0.25:
            continue
        low = np.array(
            (-width / 2 + column * width / 2, -depth / 2 + row * depth / 2, layer * rise)
        )
        gap = rng.uniform(0.0, 0.03, 2)
        high = np.add(low, (width / 2 - 0.01 - gap[0], depth / 2 - 0.01 - gap[1], rise))
        shapes.append(box(low, high, fit(Look.CARDBOARD, width / 2, rise, tint)))
    return (shapes, shapes) if shapes else _one_carton(rng, width, depth, height)


def _one_carton(rng: np.random.Generator, width: float, depth: float, height: float) -> Shapes:
    """One large box with a coloured label on both open sides."""
    x, y = 0.48 * width, 0.48 * depth
    top = height * rng.uniform(0.55, 1.0)
    tint = CLOTHS[rng.integers(len(CLOTHS))]
    body = box((-x, -y, 0), (x, y, top), fit(Look.CARDBOARD, 2 * x, top))
    label = front((-0.15, 0.3 * top), (0.15, 0.3 * top + 0.2), -y - 0.004, paint(Look.PLAIN, tint))
    return [body, label, label.move((0, 0, 0), np.pi)], [body]


def _crates(rng: np.random.Generator, width: float, depth: float, height: float) -> Shapes:
    """Stacks of plastic crates of one colour."""
    tint = CLOTHS[rng.integers(len(CLOTHS))]
    shapes = []
    for row, column in np.ndindex(2, 2):
        for layer in range(int(rng.integers(1, 3))):
            low = np.array(
                (-width / 2 + column * width / 2, -depth / 2 + row * depth / 2, 0.3 * layer)
            )
            high = np.add(low, (width / 2 - 0.02, depth / 2 - 0.02, 0.28))
            shapes.append(box(low, high, fit(Look.CRATE, width / 2, 0.28, tint)))
    return shapes, shapes


def _drums(rng: np.random.Generator, width: float, depth: float, height: float) -> Shapes:
    """Drums with a rim, of one colour."""
    cover = paint(Look.PLAIN, CLOTHS[rng.integers(len(CLOTHS))])
    radius = 0.24 * min(width, depth)
    tall = min(height, 0.62)
    shapes = [
        cylinder((u * width / 4, v * depth / 4, 0), tall, (radius, radius), cover, 9)
        for u in (-1, 1)
        for v in (-1, 1)
    ]
    return shapes, shapes


def pallet_stack(rng: np.random.Generator) -> Thing:
    """Empty pallets on top of each other."""
    layers = [_pallet(1.2, 0.8) for _ in range(int(rng.integers(2, 7)))]
    visual = [mesh.move((0, 0, 0.14 * k)) for k, (seen, _) in enumerate(layers) for mesh in seen]
    solid = [mesh.move((0, 0, 0.14 * k)) for k, (_, hit) in enumerate(layers) for mesh in hit]
    return thing("pallets", visual, solid)


def loaded_pallet(rng: np.random.Generator) -> Thing:
    """A pallet with goods, waiting to be stored."""
    seen, hit = _load(rng, 1.2, 0.8, 1.2)
    return thing("pallet", seen, hit)


def cage(rng: np.random.Generator) -> Thing:
    """A roll cage of thin bars with boxes inside."""
    steel = paint(Look.PLAIN, GREY)
    x, y = 0.4, 0.35
    base = block((-x, -y, 0.16), (x, y, 0.20), steel)
    bars = [
        tube((u, v, 0.2), (u, v, 1.6), (0.012, 0.012), steel, 4)
        for v in (-y, y)
        for u in np.linspace(-x, x, 6)
    ]
    wheels = [
        wheel(u, v, 0.08, 0.04, paint(Look.PLAIN, DARK))
        for u in (-x + 0.08, x - 0.08)
        for v in (-y + 0.06, y - 0.06)
    ]
    seen, hit = _cartons(rng, 0.7, 0.6, 0.9)
    inside = [mesh.move((0, 0, 0.2)) for mesh in seen]
    return thing(
        "roll_cage",
        [base, *bars, *wheels, *inside],
        [base, *wheels, *(mesh.move((0, 0, 0.2)) for mesh in hit)],
    )


def gate(number: int, width: float, height: float) -> Thing:
    """A closed roller gate with its number and bumpers; its back is at y = 0."""
    x = width / 2
    leaf = front((-x, 0), (x, height), -0.03, paint(Look.SHUTTER, (0.82, 0.86, 0.9)))
    posts = [block((u - 0.1, -0.1, 0), (u + 0.1, 0, height), paint(Look.HAZARD)) for u in (-x, x)]
    plate = front((-0.3, 1.3), (0.3, 1.9), -0.035, cut(Look.LABELS, number, 0.6, 0.6, _YELLOW))
    bumpers = [
        block((u - 0.12, -0.2, 0.1), (u + 0.12, -0.03, 0.6), paint(Look.PLAIN, DARK))
        for u in (-0.7 * x, 0.7 * x)
    ]
    head = block((-x - 0.1, -0.25, height), (x + 0.1, 0, height + 0.35), paint(Look.PLAIN, GREY))
    shapes = [leaf, *posts, plate, *bumpers, head]
    return thing("gate", shapes, [leaf, *posts, *bumpers, head])


def row_sign(number: int) -> Thing:
    """A plate with a row's number, to hang at the end of a row of racks; faces -y."""
    plate = block((-0.25, -0.02, 0), (0.25, 0, 0.5), paint(Look.PLAIN, BLUE))
    face = front((-0.22, 0.03), (0.22, 0.47), -0.023, cut(Look.LABELS, number, 0.44, 0.44, _YELLOW))
    return flat("sign", [plate, face])


def marking(width: float, depth: float, tint: Rgb) -> Thing:
    """The outline of a rectangle painted on the floor, 8 cm wide."""
    x, y, line, z = width / 2, depth / 2, 0.08, 0.003
    low_high = (
        (-x, -y, x, -y + line),
        (-x, y - line, x, y),
        (-x, -y + line, -x + line, y - line),
        (x - line, -y + line, x, y - line),
    )
    quads = [[(a, b, z), (c, b, z), (c, d, z), (a, d, z)] for a, b, c, d in low_high]
    return flat("marking", [panels(quads, paint(Look.PLAIN, tint))], is_ground=True)


_YELLOW: Rgb = (0.98, 0.84, 0.20)
