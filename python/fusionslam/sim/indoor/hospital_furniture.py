# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Hospital furniture: beds on wheels, drip stands, curtains, benches. Fronts face -y.

Objects that many rooms share are built once.
"""

from functools import cache

import numpy as np

from fusionslam.sim.indoor.objects import Thing, block, cylinder, flat, front, legs, thing, wheel
from fusionslam.sim.indoor.textures import DARK, GREY, WHITE, Look, cut, fit
from fusionslam.sim.mesh import Mesh, Rgb, box, paint, tapered_box, tube

_STEEL: Rgb = (0.78, 0.80, 0.82)


def _castors(width: float, depth: float, radius: float) -> list[Mesh]:
    """Four wheels below the corners of a footprint centred on the origin."""
    dark, x, y = paint(Look.PLAIN, DARK), width / 2 - radius, depth / 2 - radius
    return [wheel(u, v, radius, 0.04, dark) for u in (-x, x) for v in (-y, y)]


@cache
def sickbed(blanket: Rgb) -> Thing:
    """A hospital bed on wheels, its head at +y, with rails at both sides."""
    steel, white = paint(Look.PLAIN, _STEEL), paint(Look.FABRIC, WHITE)
    wheels = _castors(0.9, 1.9, 0.07)
    base = block((-0.38, -0.9, 0.16), (0.38, 0.9, 0.24), steel)
    posts = [block((-0.06, y - 0.06, 0.24), (0.06, y + 0.06, 0.46), steel) for y in (-0.6, 0.6)]
    forks = [
        block((x - 0.03, y - 0.03, 0.1), (x + 0.03, y + 0.03, 0.2), steel)
        for x in (-0.36, 0.36)
        for y in (-0.87, 0.87)
    ]
    deck = block((-0.46, -1.0, 0.46), (0.46, 1.0, 0.54), steel)
    mattress = box((-0.44, -0.97, 0.54), (0.44, 0.97, 0.68), white)
    cover = box((-0.46, -0.98, 0.50), (0.46, 0.35, 0.70), paint(Look.FABRIC, blanket))
    pillow = tapered_box((-0.3, 0.5, 0.68), (0.3, 0.92, 0.8), (0.8, 0.7), white)
    ends = [
        block((-0.46, y - 0.025, 0.4), (0.46, y + 0.025, top), paint(Look.WOOD, (0.86, 0.74, 0.56)))
        for y, top in ((-1.02, 0.9), (1.02, 1.1))
    ]
    rails = [tube((x, -0.3, 0.85), (x, 0.6, 0.85), (0.018, 0.018), steel, 5) for x in (-0.48, 0.48)]
    visual = [*wheels, base, *posts, *forks, deck, mattress, cover, pillow, *ends, *rails]
    body = block((-0.46, -1.0, 0.46), (0.46, 1.0, 0.69))
    return thing("sickbed", visual, [*wheels, base, *posts, *forks, body, *ends])


@cache
def cabinet(tint: Rgb) -> Thing:
    """A bedside cabinet on castors."""
    body = block((-0.22, -0.2, 0.1), (0.22, 0.2, 0.8), paint(Look.PLAIN, WHITE))
    face = front((-0.22, 0.1), (0.22, 0.8), -0.204, fit(Look.DRAWERS, 0.44, 0.7, tint))
    wheels = _castors(0.44, 0.4, 0.05)
    return thing("bedside_cabinet", [body, face, *wheels], [body, *wheels])


@cache
def drip_stand() -> Thing:
    """A drip stand: a pole on five feet with a bag."""
    steel = paint(Look.PLAIN, _STEEL)
    feet = [
        tube((0.27 * np.cos(a), 0.27 * np.sin(a), 0.04), (0, 0, 0.09), (0.02, 0.02), steel, 5)
        for a in np.arange(5) * 2 * np.pi / 5
    ]
    pole = cylinder((0, 0, 0.08), 1.8, (0.015, 0.015), steel, 6)
    bag = block((0.04, -0.03, 1.5), (0.16, 0.03, 1.8), paint(Look.PLAIN, (0.9, 0.95, 1.0)))
    return thing("drip_stand", [*feet, pole, bag], [*feet, pole, bag])


def bed_curtain(tint: Rgb, drawn: float) -> Thing:
    """A curtain along x on a rail 2.2 m long; ``drawn`` metres of it hang from the low end."""
    cloth = block((-1.1, -0.03, 0.3), (-1.1 + drawn, 0.03, 2.15), paint(Look.CURTAIN, tint))
    rail = tube((-1.1, 0, 2.17), (1.1, 0, 2.17), (0.015, 0.015), paint(Look.PLAIN, _STEEL), 5)
    return thing("curtain", [cloth, rail], [cloth])


@cache
def radiator() -> Thing:
    """A radiator on feet, for the place below a window."""
    body = block((-0.6, -0.05, 0.12), (0.6, 0.05, 0.7), paint(Look.CORRUGATED, (1.05,) * 3))
    feet = [
        box((x, -0.03, 0), (x + 0.05, 0.05, 0.12), paint(Look.PLAIN, GREY)) for x in (-0.5, 0.45)
    ]
    return thing("radiator", [body, *feet], [body, *feet])


def bench(tint: Rgb, seats: int) -> Thing:
    """Seats in a row on a beam with two feet."""
    steel, x = paint(Look.PLAIN, _STEEL), 0.28 * seats
    beam = block((-x, 0.0, 0.3), (x, 0.06, 0.36), steel)
    feet = [
        block((u - 0.03, -0.25, 0.0), (u + 0.03, 0.25, 0.04), steel) for u in (-0.7 * x, 0.7 * x)
    ]
    stems = [
        block((u - 0.03, 0.0, 0.04), (u + 0.03, 0.06, 0.3), steel) for u in (-0.7 * x, 0.7 * x)
    ]
    shells = []
    for left in np.arange(seats) * 0.56 - x:
        cover = paint(Look.FABRIC, tint)
        shells.append(block((left + 0.03, -0.26, 0.38), (left + 0.53, 0.2, 0.43), cover))
        shells.append(block((left + 0.03, 0.18, 0.5), (left + 0.53, 0.24, 0.85), cover))
    return thing("bench", [beam, *feet, *stems, *shells], [beam, *feet, *stems, *shells])


def trolley(tint: Rgb) -> Thing:
    """A trolley with three shelves and coloured boxes."""
    steel = paint(Look.PLAIN, _STEEL)
    shelves = [block((-0.4, -0.22, z), (0.4, 0.22, z + 0.03), steel) for z in (0.16, 0.5, 0.84)]
    posts = [
        block((x - 0.015, y - 0.015, 0.1), (x + 0.015, y + 0.015, 0.95), steel)
        for x in (-0.38, 0.38)
        for y in (-0.2, 0.2)
    ]
    boxes = [
        box((-0.32, -0.16, 0.19), (0.0, 0.16, 0.38), paint(Look.PLAIN, tint)),
        box((0.02, -0.16, 0.53), (0.34, 0.16, 0.7), paint(Look.PLAIN, WHITE)),
    ]
    shapes = [*shelves, *posts, *boxes, *_castors(0.8, 0.44, 0.05)]
    return thing("trolley", shapes, shapes)


def wheelchair() -> Thing:
    """A wheelchair with two large wheels, facing -y."""
    dark, steel = paint(Look.PLAIN, DARK), paint(Look.PLAIN, _STEEL)
    wheels = [wheel(x, 0.08, 0.3, 0.04, dark, along=1) for x in (-0.28, 0.28)]
    small = [wheel(x, -0.3, 0.09, 0.03, dark, along=1) for x in (-0.22, 0.22)]
    seat = block((-0.23, -0.25, 0.48), (0.23, 0.22, 0.52), paint(Look.FABRIC, (0.2, 0.3, 0.6)))
    back = block((-0.23, 0.2, 0.52), (0.23, 0.24, 0.95), paint(Look.FABRIC, (0.2, 0.3, 0.6)))
    rest = block((-0.2, -0.45, 0.1), (0.2, -0.3, 0.13), steel)
    shapes = [*wheels, *small, seat, back, rest]
    return thing("wheelchair", shapes, shapes)


def reception(tint: Rgb) -> Thing:
    """A reception counter with a raised front and a screen."""
    body = box((-1.2, -0.35, 0), (1.2, -0.15, 1.1), paint(Look.WOOD, tint))
    top = block((-1.25, -0.4, 1.1), (1.25, -0.1, 1.14), paint(Look.WOOD, WHITE))
    shelf = block((-1.2, -0.15, 0.7), (1.2, 0.4, 0.74), paint(Look.WOOD, WHITE))
    ends = [box((x, -0.15, 0), (x + 0.04, 0.4, 0.7), paint(Look.WOOD, tint)) for x in (-1.2, 1.16)]
    screen = block((-0.3, 0.0, 0.85), (0.2, 0.04, 1.2), paint(Look.SCREEN))
    shapes = [body, top, shelf, *ends, screen]
    return thing("reception", shapes, shapes)


def couch(tint: Rgb) -> Thing:
    """An examination couch on four legs, its head at +y."""
    pad = block((-0.33, -0.95, 0.62), (0.33, 0.95, 0.72), paint(Look.FABRIC, tint))
    frame = block((-0.3, -0.9, 0.55), (0.3, 0.9, 0.62), paint(Look.PLAIN, _STEEL))
    head = tapered_box((-0.3, 0.6, 0.72), (0.3, 0.95, 0.84), (0.9, 0.8), paint(Look.FABRIC, tint))
    feet = legs(0.6, 1.7, 0.55, 0.05, paint(Look.PLAIN, _STEEL))
    return thing("couch", [pad, frame, head, feet], [pad, frame, feet])


def extinguisher() -> Thing:
    """A red fire extinguisher on the floor at a wall."""
    red = paint(Look.PLAIN, (0.82, 0.10, 0.08))
    body = cylinder((0, 0, 0.04), 0.45, (0.08, 0.08), red, 10)
    neck = cylinder((0, 0, 0.49), 0.1, (0.05, 0.03), paint(Look.PLAIN, DARK), 6)
    foot = cylinder((0, 0, 0), 0.04, (0.09, 0.09), paint(Look.PLAIN, DARK), 10)
    return thing("extinguisher", [body, neck, foot], [body, neck, foot])


def handrail(length: float, tint: Rgb) -> Thing:
    """A rail and a bumper board along a wall; their backs are at y = 0."""
    x = length / 2
    rail = block((-x, -0.07, 0.85), (x, -0.03, 0.95), paint(Look.WOOD, (0.8, 0.62, 0.42)))
    board = block((-x, -0.02, 0.2), (x, 0.0, 0.45), paint(Look.PLAIN, tint))
    return thing("handrail", [rail, board], [rail, board])


def number_plate(number: int, tint: Rgb) -> Thing:
    """A room's number plate; its back is at y = 0."""
    face = front((-0.14, 0), (0.14, 0.28), -0.012, cut(Look.LABELS, number, 0.28, 0.28, tint))
    return flat("number", [face])


def lift(tint: Rgb) -> Thing:
    """Closed lift doors in a frame; their backs are at y = 0."""
    doors = [
        front((x, 0), (x + 0.55, 2.1), -0.02, fit(Look.PLAIN, 0.55, 2.1, _STEEL))
        for x in (-0.55, 0.0)
    ]
    frame = [
        block((x, -0.08, 0), (x + 0.1, 0, 2.1), paint(Look.PLAIN, tint)) for x in (-0.65, 0.55)
    ]
    head = block((-0.65, -0.08, 2.1), (0.65, 0, 2.25), paint(Look.PLAIN, tint))
    seam = front((-0.01, 0), (0.01, 2.1), -0.024, paint(Look.PLAIN, DARK))
    return thing("lift", [*doors, *frame, head, seam], [*doors, *frame, head])
