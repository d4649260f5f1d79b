# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Furniture, and the colours that it comes in. Fronts face -y.

Pieces of fixed shape are rows of ``furniture.yaml``; those whose size or contents vary have a
function here. Legs and frames are modelled, because a low camera sees little else.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from fusionslam.sim.canvas import read_table
from fusionslam.sim.indoor.objects import Thing, block, cylinder, flat, front, legs, thing, wheel
from fusionslam.sim.indoor.textures import BLUE, DARK, GREY, STEEL, TIMBER, WHITE, Look, cut, fit
from fusionslam.sim.mesh import (
    Mesh,
    Paint,
    Rgb,
    box,
    level,
    paint,
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
PALETTE: Mapping[str, Rgb] = {
    "BLUE": BLUE,
    "DARK": DARK,
    "GREY": GREY,
    "STEEL": STEEL,
    "TIMBER": TIMBER,
    "WHITE": WHITE,
    "YELLOW": (0.98, 0.84, 0.20),
    "YELLOW_CLOTH": CLOTHS[3],
    "OAK": (0.88, 0.76, 0.58),
}
_SHAPES: Mapping[str, Callable[..., Mesh]] = {
    "box": box,
    "block": block,
    "tapered_box": tapered_box,
    "tube": tube,
    "cylinder": cylinder,
    "wheel": wheel,
    "legs": legs,
    "front": front,
}


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


@lru_cache(maxsize=256)
def make_piece(kind: str, style: Style | None = None, tint: Rgb = WHITE, number: int = 0) -> Thing:
    """A piece of furniture of the table, in the colours of a style or with one of its own.

    Args:
        kind: key of the table.
        style: of its room.
        tint: its own colour.
        number: of the print on it, from 0.
    """
    colors = {**PALETTE, "tint": tint, **(vars(style) if style else {})}
    visual, solid = [], []
    for row in read_table(Path(__file__).with_suffix(".yaml"))[kind]:
        meshes = list(_make_shape(row, colors, number))
        if row.get("seen", True):
            visual += meshes
        if row.get("hit", True):
            solid += meshes
    name = kind.partition(".")[0]
    return thing(name, visual, solid) if solid else flat(name, visual)


def _make_shape(row: Mapping[str, Any], colors: Mapping[str, Rgb], number: int) -> Iterator[Mesh]:
    """The shape of one row of the table, and its copies."""
    tint, look = row.get("tint", (1.0, 1.0, 1.0)), Look[row.get("texture", "plain").upper()]
    rgb = colors[tint] if isinstance(tint, str) else tuple(tint)
    cover = Paint(look, rgb, tuple(row.get("fit", look.extent)))
    if "cell" in row:
        width, height = row["cell"]
        cover = cut(look, number, width, height, rgb)
    options = {key: row[key] for key in ("sides", "along") if key in row}
    shape = next(name for name in _SHAPES if name in row)
    for values in _copies(shape, row[shape], row):
        yield _SHAPES[shape](*values, cover, **options)


def _copies(shape: str, values: list[Any], row: Mapping[str, Any]) -> Iterator[list[Any]]:
    """The arguments of a shape, mirrored or turned as its row says."""
    if "around" in row:
        (radius, _, z), *rest = values
        for angle in np.arange(row["around"]) * 2 * np.pi / row["around"]:
            yield [(radius * np.cos(angle), radius * np.sin(angle), z), *rest]
        return
    signs = [(1, -1) if axis in row.get("mirror", "") else (1,) for axis in "xy"]
    for x, y in product(*signs):
        if shape == "wheel":
            yield [x * values[0], y * values[1], *values[2:]]
        elif shape == "tube":
            yield [*(np.array(values[:2]) * (x, y, 1)), *values[2:]]
        elif "mirror" in row:
            corners = np.array(values[:2]) * (x, y, 1)
            yield [corners.min(axis=0), corners.max(axis=0), *values[2:]]
        else:
            yield values


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
    high = np.array((width, depth)) / 2
    return flat("carpet", [level(-high, high, 0.006, cover)], is_ground=True)


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


def group(kind: str, placed: Sequence[tuple[Thing, tuple[float, float, float], float]]) -> Thing:
    """Combine several things, each with x, y, z in metres and yaw in radians, into one."""
    visual = [item.visual.move(place, yaw) for item, place, yaw in placed]
    solid = [i.collision.move(place, yaw) for i, place, yaw in placed if i.collision is not None]
    return thing(kind, visual, solid)


def bed_curtain(tint: Rgb, drawn: float) -> Thing:
    """A curtain along x on a rail 2.2 m long; ``drawn`` metres of it hang from the low end."""
    cloth = block((-1.1, -0.03, 0.3), (-1.1 + drawn, 0.03, 2.15), paint(Look.CURTAIN, tint))
    rail = tube((-1.1, 0, 2.17), (1.1, 0, 2.17), (0.015, 0.015), paint(Look.PLAIN, STEEL), 5)
    return thing("curtain", [cloth, rail], [cloth])


def handrail(length: float, tint: Rgb) -> Thing:
    """A rail and a bumper board along a wall; their backs are at y = 0."""
    x = length / 2
    rail = block((-x, -0.07, 0.85), (x, -0.03, 0.95), paint(Look.WOOD, (0.8, 0.62, 0.42)))
    board = block((-x, -0.02, 0.2), (x, 0.0, 0.45), paint(Look.PLAIN, tint))
    return thing("handrail", [rail, board], [rail, board])
