# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Home furniture: tables, chairs, sofas, beds, shelves, plants and pictures.

Fronts face -y. Legs and frames are modelled, because a low camera sees little else.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

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

WOODS: tuple[Rgb, ...] = (
    (0.86, 0.66, 0.42),
    (0.62, 0.40, 0.24),
    (0.42, 0.26, 0.17),
    (0.95, 0.86, 0.70),
    (0.98, 0.97, 0.94),
    (0.36, 0.36, 0.38),
)
CLOTHS: tuple[Rgb, ...] = (
    (0.78, 0.18, 0.16),
    (0.16, 0.30, 0.62),
    (0.18, 0.50, 0.30),
    (0.92, 0.68, 0.16),
    (0.52, 0.26, 0.56),
    (0.16, 0.58, 0.60),
    (0.90, 0.46, 0.16),
    (0.88, 0.48, 0.60),
    (0.46, 0.46, 0.48),
    (0.60, 0.44, 0.30),
)


@dataclass(frozen=True)
class Style:
    """Colours that the furniture of one room shares: wood, cloth and small things."""

    wood: Rgb
    cloth: Rgb
    accent: Rgb

    @staticmethod
    def draw(rng: np.random.Generator) -> "Style":
        """Draw a random style: a wood and two different cloths."""
        cloth, accent = rng.choice(len(CLOTHS), 2, replace=False)
        return Style(WOODS[rng.integers(len(WOODS))], CLOTHS[cloth], CLOTHS[accent])


def table(style: Style, width: float, depth: float, height: float = 0.74) -> Thing:
    """A table on four legs."""
    wood, x, y = paint(Look.WOOD, style.wood), width / 2, depth / 2
    low, high = (-x, -y, height - 0.04), (x, y, height)
    rails = block((-x + 0.05, -y + 0.05, height - 0.12), (x - 0.05, y - 0.05, height - 0.04), wood)
    shapes = [block(low, high, wood), rails, legs(width, depth, height - 0.04, 0.07, wood)]
    return thing("table", shapes, [block(low, high), legs(width, depth, height - 0.04, 0.07)])


def coffee_table(style: Style) -> Thing:
    """A low table with a board below its top."""
    wood = paint(Look.WOOD, style.wood)
    top = block((-0.5, -0.28, 0.38), (0.5, 0.28, 0.42), wood)
    board = block((-0.47, -0.24, 0.14), (0.47, 0.24, 0.17), wood)
    shapes = [top, board, legs(1.0, 0.56, 0.38, 0.06, wood)]
    return thing("coffee_table", shapes, shapes)


def round_table(style: Style, radius: float = 0.5) -> Thing:
    """A round table on a column with a foot."""
    wood, metal = paint(Look.WOOD, style.wood), paint(Look.PLAIN, DARK)
    top = [
        cylinder((0, 0, 0.71), 0.04, (radius, radius), wood, 16),
        tube((0, 0, 0.71), (0, 0, 0.712), (1e-4, radius), wood, 16),
    ]
    foot = cylinder((0, 0, 0), 0.03, (0.28, 0.24), metal, 14)
    column = cylinder((0, 0, 0.03), 0.68, (0.05, 0.05), metal, 8)
    return thing("round_table", [*top, foot, column], [*top, foot, column])


def chair(style: Style, seat_look: Look = Look.FABRIC) -> Thing:
    """A chair with four legs and an open back."""
    wood, cloth = paint(Look.WOOD, style.wood), paint(seat_look, style.cloth)
    seat = block((-0.21, -0.21, 0.42), (0.21, 0.21, 0.47), cloth)
    slats = [block((-0.19, 0.18, z), (0.19, 0.20, z + 0.09), wood) for z in (0.58, 0.76)]
    posts = [block((x, 0.175, 0.47), (x + 0.035, 0.21, 0.88), wood) for x in (-0.21, 0.175)]
    back = block((-0.21, 0.175, 0.56), (0.21, 0.21, 0.88))
    shapes = [seat, *slats, *posts, legs(0.42, 0.42, 0.42, 0.04, wood)]
    return thing("chair", shapes, [seat, back, legs(0.42, 0.42, 0.42, 0.04)])


def stool(style: Style) -> Thing:
    """A round stool on three legs."""
    wood = paint(Look.WOOD, style.wood)
    seat = cylinder((0, 0, 0.42), 0.05, (0.17, 0.17), paint(Look.FABRIC, style.accent), 12)
    feet = [
        tube((0.16 * np.cos(a), 0.16 * np.sin(a), 0.018), (0, 0, 0.44), (0.018, 0.018), wood, 5)
        for a in np.arange(3) * 2 * np.pi / 3
    ]
    return thing("stool", [seat, *feet], [seat, *feet])


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


def desk(style: Style) -> Thing:
    """A desk with drawers on one side and a screen on top."""
    wood = paint(Look.WOOD, style.wood)
    top = block((-0.7, -0.35, 0.71), (0.7, 0.35, 0.74), wood)
    drawers = box((0.25, -0.33, 0.04), (0.68, 0.33, 0.71), wood)
    face = front((0.25, 0.04), (0.68, 0.71), -0.335, fit(Look.DRAWERS, 0.43, 0.67, style.wood))
    panel = box((-0.7, -0.33, 0), (-0.66, 0.33, 0.71), wood)
    screen = block((-0.35, 0.1, 0.84), (0.25, 0.13, 1.2), paint(Look.SCREEN))
    stand = box((-0.1, 0.08, 0.74), (0.0, 0.16, 0.86), paint(Look.PLAIN, DARK))
    solid = [top, drawers, panel, screen]
    return thing("desk", [top, drawers, face, panel, screen, stand], solid)


def television(style: Style) -> Thing:
    """A low cabinet with a television on it."""
    wood = paint(Look.WOOD, style.wood)
    body = block((-0.8, -0.2, 0.10), (0.8, 0.2, 0.45), wood)
    face = front((-0.8, 0.10), (0.8, 0.45), -0.204, fit(Look.DRAWERS, 0.8, 1.05, style.wood))
    feet = legs(1.5, 0.36, 0.10, 0.05, paint(Look.PLAIN, DARK))
    screen = block((-0.6, 0.02, 0.50), (0.6, 0.06, 1.18), paint(Look.PLAIN, DARK))
    picture = front((-0.58, 0.52), (0.58, 1.16), 0.018, fit(Look.SCREEN, 1.16, 0.64))
    stand = box((-0.2, -0.05, 0.45), (0.2, 0.12, 0.51), paint(Look.PLAIN, DARK))
    return thing("television", [body, face, feet, screen, picture, stand], [body, feet, screen])


def fireplace(style: Style) -> Thing:
    """A chimney breast with a dark hearth and glowing logs."""
    stone, dark = paint(Look.TILES, style.accent), paint(Look.PLAIN, (0.10, 0.08, 0.08))
    pillars = [box((x, -0.22, 0), (x + 0.3, 0.22, 1.05), stone) for x in (-0.7, 0.4)]
    mantel = block((-0.8, -0.28, 1.0), (0.8, 0.22, 1.12), paint(Look.WOOD, style.wood))
    hearth = front((-0.4, 0), (0.4, 1.0), 0.1, dark)
    logs = [
        tube((-0.3, y, z), (0.3, y, z), (0.06, 0.06), paint(Look.PLAIN, (0.95, 0.42, 0.12)), 6)
        for y, z in ((-0.08, 0.06), (0.02, 0.06), (-0.03, 0.16))
    ]
    back = block((-0.4, 0.1, 0), (0.4, 0.22, 1.0))
    return thing("fireplace", [*pillars, mantel, hearth, *logs], [*pillars, mantel, back])


def piano(style: Style) -> Thing:
    """An upright piano with its keys."""
    black = paint(Look.WOOD, (0.16, 0.13, 0.13))
    body = box((-0.75, -0.08, 0), (0.75, 0.28, 1.2), black)
    shelf = block((-0.75, -0.30, 0.62), (0.75, -0.08, 0.72), black)
    keys = box((-0.68, -0.28, 0.72), (0.68, -0.12, 0.735), paint(Look.PLAIN, WHITE))
    posts = [box((x, -0.28, 0), (x + 0.08, -0.2, 0.62), black) for x in (-0.75, 0.67)]
    return thing("piano", [body, shelf, keys, *posts], [body, shelf, *posts])


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


def lamp(style: Style) -> Thing:
    """A lamp on a pole with a shade of cloth."""
    metal = paint(Look.PLAIN, DARK)
    foot = cylinder((0, 0, 0), 0.03, (0.15, 0.14), metal)
    pole = cylinder((0, 0, 0.03), 1.4, (0.015, 0.015), metal, 5)
    shade = cylinder((0, 0, 1.3), 0.3, (0.22, 0.14), paint(Look.FABRIC, style.accent), 10)
    return thing("lamp", [foot, pole, shade], [foot, pole, shade])


def waste_bin(tint: Rgb) -> Thing:
    """A round waste-paper bin."""
    pail = cylinder((0, 0, 0), 0.32, (0.11, 0.14), paint(Look.PLAIN, tint), 10)
    return thing("bin", [pail], [pail])


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
