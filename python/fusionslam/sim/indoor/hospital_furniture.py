# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Furniture of hospitals whose size varies: curtains, benches, handrails, number plates.

Pieces of fixed shape are rows of furniture.yaml; hospital.py places both.
"""

import numpy as np

from fusionslam.sim.indoor.objects import Thing, block, flat, front, thing
from fusionslam.sim.indoor.textures import STEEL, Look, cut
from fusionslam.sim.mesh import Rgb, paint, tube


def bed_curtain(tint: Rgb, drawn: float) -> Thing:
    """A curtain along x on a rail 2.2 m long; ``drawn`` metres of it hang from the low end."""
    cloth = block((-1.1, -0.03, 0.3), (-1.1 + drawn, 0.03, 2.15), paint(Look.CURTAIN, tint))
    rail = tube((-1.1, 0, 2.17), (1.1, 0, 2.17), (0.015, 0.015), paint(Look.PLAIN, STEEL), 5)
    return thing("curtain", [cloth, rail], [cloth])


def bench(tint: Rgb, seats: int) -> Thing:
    """Seats in a row on a beam with two feet."""
    steel, x = paint(Look.PLAIN, STEEL), 0.28 * seats
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
