# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Furniture of homes whose size or contents vary: tables, sofas, beds, shelves, plants, pictures.

Pieces of fixed shape are rows of furniture.yaml. Fronts face -y. Legs and frames are modelled,
because a low camera sees little else.
"""

from itertools import pairwise

import numpy as np

from fusionslam.sim.indoor.furniture import CLOTHS, Style
from fusionslam.sim.indoor.objects import Thing, block, cylinder, flat, front, legs, thing
from fusionslam.sim.indoor.textures import DARK, WHITE, Look, cut, fit
from fusionslam.sim.mesh import (
    Mesh,
    Rgb,
    box,
    join_meshes,
    paint,
    panels,
    tapered_box,
    triangles,
    tube,
)


def table(style: Style, width: float, depth: float) -> Thing:
    """A table on four legs."""
    wood, x, y, height = paint(Look.WOOD, style.wood), width / 2, depth / 2, 0.74
    low, high = (-x, -y, height - 0.04), (x, y, height)
    rails = block((-x + 0.05, -y + 0.05, height - 0.12), (x - 0.05, y - 0.05, height - 0.04), wood)
    shapes = [block(low, high, wood), rails, legs(width, depth, height - 0.04, 0.07, wood)]
    return thing("table", shapes, [block(low, high), legs(width, depth, height - 0.04, 0.07)])


def sofa(style: Style, width: float, kind: str = "sofa") -> Thing:
    """A sofa or armchair on short feet, with seat cushions of 0.6 .. 0.8 m."""
    cloth, cushion = paint(Look.FABRIC, style.cloth), paint(Look.FABRIC, style.accent)
    x, arm = width / 2, 0.14
    base = block((-x, -0.42, 0.10), (x, 0.42, 0.30), cloth)
    back = block((-x, 0.22, 0.30), (x, 0.42, 0.82), cloth)
    arms = [block((u, -0.42, 0.30), (u + arm, 0.22, 0.58), cloth) for u in (-x, x - arm)]
    count = max(1, round((width - 2 * arm) / 0.7))
    edges = np.linspace(-x + arm, x - arm, count + 1)
    seats = [
        tapered_box((u + 0.01, -0.43, 0.30), (v - 0.01, 0.22, 0.44), (0.96, 0.94), cloth)
        for u, v in pairwise(edges)
    ]
    pillow = tapered_box(
        (-x + arm + 0.04, 0.08, 0.44), (-x + arm + 0.44, 0.22, 0.78), (0.8, 0.5), cushion
    )
    feet = legs(width - 0.1, 0.74, 0.10, 0.05, paint(Look.WOOD, DARK))
    seat = block((-x + arm, -0.42, 0.30), (x - arm, 0.22, 0.44))
    return thing(kind, [base, back, *arms, *seats, pillow, feet], [base, back, *arms, seat, feet])


def bed(style: Style, width: float) -> Thing:
    """A bed on legs, its head at +y, with a plaid over its lower part."""
    wood, x = paint(Look.WOOD, style.wood), width / 2
    frame = block((-x, -1.0, 0.16), (x, 1.0, 0.32), wood)
    mattress = box((-x + 0.03, -0.97, 0.32), (x - 0.03, 0.97, 0.50), paint(Look.FABRIC, WHITE))
    plaid = box((-x - 0.01, -1.01, 0.20), (x + 0.01, 0.30, 0.53), paint(Look.PLAID, style.cloth))
    head = block((-x, 0.98, 0.0), (x, 1.04, 1.0), wood)
    pillows = [
        tapered_box(
            (u, 0.52, 0.50), (u + 0.62, 0.94, 0.63), (0.8, 0.7), paint(Look.FABRIC, style.accent)
        )
        for u in ([-0.31] if width < 1.3 else [-0.68, 0.06])
    ]
    feet = legs(width, 2.0, 0.16, 0.07, wood)
    solid = [block((-x, -1.0, 0.16), (x, 1.0, 0.52)), head, feet]
    return thing("bed", [frame, mattress, plaid, head, *pillows, feet], solid)


def cupboard(
    style: Style, width: float, depth: float, height: float, look: Look, kind: str
) -> Thing:
    """A closed cabinet on a plinth: a wardrobe, or a chest of drawers."""
    wood, x, y = paint(Look.WOOD, style.wood), width / 2, depth / 2
    body = box((-x, -y, 0.0), (x, y, height), wood)
    doors = max(1, round(width / (0.55 if look == Look.CUPBOARD else 1.0)))
    face = front(
        (-x, 0.02), (x, height - 0.02), -y - 0.004, fit(look, width / doors, height, style.wood)
    )
    return thing(kind, [body, face], [body])


def counter(style: Style, units: int, oven: int | None = None) -> Thing:
    """Base cabinets of 0.6 m under a worktop, wall cabinets above, and tiles between them."""
    x, plinth = 0.3 * units, paint(Look.PLAIN, DARK)
    base = box((-x, -0.25, 0.0), (x, 0.3, 0.1), plinth)
    body = block((-x, -0.3, 0.1), (x, 0.3, 0.86), paint(Look.WOOD, style.cloth))
    top = block((-x, -0.32, 0.86), (x, 0.3, 0.90), paint(Look.WOOD, style.wood))
    tiles = front((-x, 0.9), (x, 1.45), 0.29, paint(Look.TILES, style.accent))
    upper = block((-x, -0.05, 1.45), (x, 0.3, 2.1), paint(Look.WOOD, style.cloth))
    door, above = (fit(Look.CUPBOARD, 0.6, height, style.cloth) for height in (0.76, 0.65))
    shapes = [base, body, top, tiles, upper, front((-x, 1.45), (x, 2.1), -0.054, above)]
    for k in range(units):
        cover = fit(Look.OVEN, 0.6, 0.76) if k == oven else door
        shapes.append(front((-x + 0.6 * k, 0.1), (-x + 0.6 * (k + 1), 0.86), -0.304, cover))
    return thing("kitchen_counter", shapes, [base, body, top, upper])


def bookcase(rng: np.random.Generator, style: Style, width: float, height: float) -> Thing:
    """Boards with rows of books, a few of them empty."""
    wood, x = paint(Look.WOOD, style.wood), width / 2
    sides = [box((u, -0.15, 0), (u + 0.025, 0.15, height), wood) for u in (-x, x - 0.025)]
    back = front((-x, 0), (x, height), 0.14, wood)
    shapes = [*sides, back]
    for z in np.arange(0.06, height, 0.36):
        shapes.append(block((-x, -0.15, z), (x, 0.15, z + 0.022), wood))
        if z + 0.36 < height and rng.random() < 0.85:
            cover = paint(Look.BOOKS, offset=(float(rng.random()), 0.0))
            end = x - 0.03 - rng.uniform(0, 0.3) * width
            shapes.append(front((-x + 0.03, z + 0.022), (end, z + 0.34), -0.12, cover))
    return thing("bookcase", shapes, [box((-x, -0.15, 0), (x, 0.15, height), wood)])


def plant(rng: np.random.Generator) -> Thing:
    """A pot with a bush of leaves."""
    pot = paint(Look.PLAIN, CLOTHS[rng.integers(len(CLOTHS))])
    height, reach = rng.uniform(0.7, 1.4), rng.uniform(0.22, 0.32)
    vessel = cylinder((0, 0, 0), 0.3, (0.13, 0.18), pot, 10)
    soil = paint(Look.LEAVES, (0.3, 0.22, 0.16))
    stem = tube((0, 0, 0.3), (0, 0, height), (0.02, 0.015), soil, 5)
    middle = (0.3 + height) / 2 + 0.1
    leaves = _leaves(rng, middle, reach, (height - 0.25) / 2)
    crown = cylinder((0, 0, 0.42), height - 0.35, (0.8 * reach, 0.8 * reach), sides=8)
    return thing("plant", [vessel, stem, leaves], [vessel, crown])


def _leaves(rng: np.random.Generator, middle: float, reach: float, rise: float) -> Mesh:
    outward = rng.standard_normal((70, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    at = outward * (reach, reach, rise) * rng.uniform(0.5, 1.0, (70, 1)) + (0, 0, middle)
    corners = at[:, None] + rng.uniform(-0.09, 0.09, (70, 3, 3))
    uv = np.tile(np.array([(0, 0), (0.4, 0), (0.2, 0.4)]), (70, 1, 1))
    green = (0.25, 0.50, 0.20) if rng.random() < 0.6 else (0.45, 0.58, 0.25)
    return triangles(corners, uv, paint(Look.LEAVES, green))


def toys(rng: np.random.Generator) -> Thing:
    """A pile of coloured blocks and a ball."""
    shapes = []
    for k in range(7):
        x, y = rng.uniform(-0.28, 0.28, 2)
        side = rng.uniform(0.05, 0.1)
        low, high = (x - side, y - side, 0), (x + side, y + side, 1.6 * side)
        shapes.append(box(low, high, paint(Look.PLAIN, CLOTHS[k])))
    return thing("toys", shapes, shapes)


def carpet(tint: Rgb, width: float, depth: float, look: Look = Look.RUG) -> Thing:
    """A thin carpet that counts as ground."""
    cover = fit(look, width, depth, tint) if look == Look.RUG else paint(look, tint)
    x, y, z = width / 2, depth / 2, 0.006
    top = panels([[(-x, -y, z), (x, -y, z), (x, y, z), (-x, y, z)]], cover)
    return flat("carpet", [top], is_ground=True)


def picture(number: int, width: float, height: float) -> Thing:
    """A framed picture; its back is at y = 0, its lower edge at z = 0."""
    x = width / 2
    frame = block((-x - 0.02, -0.02, -0.02), (x + 0.02, 0, height + 0.02), paint(Look.WOOD, DARK))
    face = front((-x, 0), (x, height), -0.022, cut(Look.PICTURES, number, width, height))
    return flat("picture", [frame, face])


def curtains(tint: Rgb, width: float, height: float) -> Thing:
    """A pair of drawn-back curtains on a rail; their backs are at y = 0."""
    cloth = paint(Look.CURTAIN, tint)
    x = width / 2
    pair = [block((u, -0.09, 0), (u + 0.3, -0.05, height), cloth) for u in (-x, x - 0.3)]
    rail = tube((-x, -0.07, height), (x, -0.07, height), (0.015, 0.015), paint(Look.WOOD, DARK), 5)
    return flat("curtains", [*pair, rail])


def group(kind: str, placed: list[tuple[Thing, float, float, float]]) -> Thing:
    """Combine several things, each with x, y and yaw, into one."""
    visual = [item.visual.move((x, y, 0), yaw) for item, x, y, yaw in placed]
    solid = [
        item.collision.move((x, y, 0), yaw)
        for item, x, y, yaw in placed
        if item.collision is not None
    ]
    return thing(kind, [join_meshes(visual)], solid)
