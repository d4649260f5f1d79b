# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Warehouse furniture: racks and their loads, pallets, drums, a fork-lift, benches."""

import numpy as np

from fusionslam.sim.indoor.furniture import CLOTHS, group, make_piece
from fusionslam.sim.indoor.objects import Thing, block, cylinder, flat, front, thing, wheel
from fusionslam.sim.indoor.textures import DARK, GREY, Look, fit
from fusionslam.sim.mesh import Rgb, box, level, paint, tube

BAY_M = 2.7
DEPTH_M = 1.1
_LEVELS_M = (0.12, 1.35, 2.45)
_CARDBOARD: tuple[Rgb, ...] = ((1.0, 1.0, 1.0), (0.9, 0.86, 0.8), (1.15, 1.12, 1.05))


def rack_bay(rng: np.random.Generator, fill: float) -> Thing:
    """One bay of a pallet rack along x, open to both sides, with loads on three levels."""
    placed = [(make_piece("rack_frame"), (0.0, 0.0, 0.0), 0.0)]
    for z in _LEVELS_M:
        for x in (-0.86, 0.0, 0.86):
            if rng.random() < fill:
                placed.append((_load(rng, "pallet.narrow", 0.8, 1.0, 0.85), (x, 0.0, z), 0.0))
    return group("shelf", placed)


def _load(rng: np.random.Generator, kind: str, width: float, depth: float, height: float) -> Thing:
    """A pallet with cartons, crates or drums, centred on the origin."""
    makers = (_cartons, _cartons, _one_carton, _crates, _drums)
    goods = makers[rng.integers(len(makers))](rng, width, depth, height - 0.14)
    pallet = make_piece(kind)
    return group("pallet", [(pallet, (0.0, 0.0, 0.0), 0.0), (goods, (0.0, 0.0, 0.14), 0.0)])


def _cartons(rng: np.random.Generator, width: float, depth: float, height: float) -> Thing:
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
    return thing("cartons", shapes, shapes) if shapes else _one_carton(rng, width, depth, height)


def _one_carton(rng: np.random.Generator, width: float, depth: float, height: float) -> Thing:
    """One large box with a coloured label on both open sides."""
    x, y = 0.48 * width, 0.48 * depth
    top = height * rng.uniform(0.55, 1.0)
    tint = CLOTHS[rng.integers(len(CLOTHS))]
    body = box((-x, -y, 0), (x, y, top), fit(Look.CARDBOARD, 2 * x, top))
    label = front((-0.15, 0.3 * top), (0.15, 0.3 * top + 0.2), -y - 0.004, paint(Look.PLAIN, tint))
    return thing("carton", [body, label, label.move((0, 0, 0), np.pi)], [body])


def _crates(rng: np.random.Generator, width: float, depth: float, height: float) -> Thing:
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
    return thing("crates", shapes, shapes)


def _drums(rng: np.random.Generator, width: float, depth: float, height: float) -> Thing:
    """Drums with a rim, of one colour."""
    cover = paint(Look.PLAIN, CLOTHS[rng.integers(len(CLOTHS))])
    radius = 0.24 * min(width, depth)
    tall = min(height, 0.62)
    shapes = [
        cylinder((u * width / 4, v * depth / 4, 0), tall, (radius, radius), cover, 9)
        for u in (-1, 1)
        for v in (-1, 1)
    ]
    return thing("drums", shapes, shapes)


def pallet_stack(rng: np.random.Generator) -> Thing:
    """Empty pallets on top of each other."""
    pallet, count = make_piece("pallet.long"), int(rng.integers(2, 7))
    return group("pallets", [(pallet, (0.0, 0.0, 0.14 * k), 0.0) for k in range(count)])


def loaded_pallet(rng: np.random.Generator) -> Thing:
    """A pallet with goods, waiting to be stored."""
    return _load(rng, "pallet.long", 1.2, 0.8, 1.2)


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
    frame = thing("frame", [base, *bars, *wheels], [base, *wheels])
    inside = _cartons(rng, 0.7, 0.6, 0.9)
    return group("roll_cage", [(frame, (0.0, 0.0, 0.0), 0.0), (inside, (0.0, 0.0, 0.2), 0.0)])


def marking(width: float, depth: float, tint: Rgb) -> Thing:
    """The outline of a rectangle painted on the floor, 8 cm wide."""
    x, y, line = width / 2, depth / 2, 0.08
    edges = (
        (-x, -y, x, -y + line),
        (-x, y - line, x, y),
        (-x, -y + line, -x + line, y - line),
        (x - line, -y + line, x, y - line),
    )
    lines = [level((a, b), (c, d), 0.003, paint(Look.PLAIN, tint)) for a, b, c, d in edges]
    return flat("marking", lines, is_ground=True)
