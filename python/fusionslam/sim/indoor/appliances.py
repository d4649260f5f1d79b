# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Furniture of kitchens and bathrooms. Fronts face -y."""

from functools import cache

from fusionslam.sim.indoor.home_furniture import Style
from fusionslam.sim.indoor.objects import Thing, block, cylinder, front, thing
from fusionslam.sim.indoor.textures import DARK, GREY, WHITE, Look, fit
from fusionslam.sim.mesh import Paint, Rgb, box, paint


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


def fridge(tint: Rgb) -> Thing:
    """A tall fridge with two doors."""
    body = box((-0.3, -0.32, 0.03), (0.3, 0.32, 1.8), paint(Look.PLAIN, tint))
    foot = box((-0.27, -0.28, 0), (0.27, 0.3, 0.03), paint(Look.PLAIN, DARK))
    lower = front((-0.3, 0.06), (0.3, 1.78), -0.325, fit(Look.CUPBOARD, 0.6, 0.86, tint))
    return thing("fridge", [body, foot, lower], [box((-0.3, -0.32, 0), (0.3, 0.32, 1.8), _plain())])


def washing_machine() -> Thing:
    """A front-loading washing machine."""
    body = box((-0.3, -0.3, 0), (0.3, 0.3, 0.85), paint(Look.PLAIN, WHITE))
    face = front((-0.3, 0), (0.3, 0.85), -0.304, fit(Look.OVEN, 0.6, 0.85))
    return thing("washing_machine", [body, face], [body])


def bathtub(tint: Rgb) -> Thing:
    """A tub with a rim and a dark hollow."""
    white = paint(Look.PLAIN, WHITE)
    body = box((-0.85, -0.38, 0), (0.85, 0.38, 0.54), paint(Look.TILES, tint))
    rim = box((-0.86, -0.39, 0.54), (0.86, 0.39, 0.57), white)
    hollow = box((-0.76, -0.29, 0.57), (0.76, 0.29, 0.572), paint(Look.PLAIN, GREY))
    return thing("bathtub", [body, rim, hollow], [body, rim])


def toilet() -> Thing:
    """A bowl and its cistern."""
    white = paint(Look.PLAIN, WHITE)
    foot = cylinder((0, -0.05, 0), 0.32, (0.14, 0.17), white, 10)
    bowl = cylinder((0, -0.08, 0.32), 0.1, (0.19, 0.2), white, 12)
    tank = block((-0.2, 0.15, 0.38), (0.2, 0.32, 0.8), white)
    return thing("toilet", [foot, bowl, tank], [foot, bowl, tank])


@cache
def washbasin() -> Thing:
    """A basin on a column with a mirror above."""
    white = paint(Look.PLAIN, WHITE)
    column = cylinder((0, 0.1, 0), 0.7, (0.1, 0.07), white, 8)
    bowl = block((-0.28, -0.22, 0.7), (0.28, 0.22, 0.86), white)
    mirror = front((-0.3, 1.1), (0.3, 1.9), 0.215, paint(Look.PLAIN, (0.74, 0.86, 0.92)))
    return thing("washbasin", [column, bowl, mirror], [column, bowl])


def _plain() -> Paint:
    return paint(Look.PLAIN)
