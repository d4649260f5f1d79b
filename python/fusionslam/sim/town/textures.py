# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The town's textures: walls, streets, leaves and cars, with the contrast that stereo needs."""

from functools import lru_cache, partial

import numpy as np

from fusionslam.sim.canvas import Canvas, Painter, noise, paint_textures, rough
from fusionslam.sim.mesh import Texture
from fusionslam.sim.town.facades import FACADES, paint_facade
from fusionslam.storage.arrays import Image


class Look(Texture):
    """The town's textures, each with its extent in metres; facades start at ``Look.FACADE``."""

    PLAIN = 0, 2.0, 2.0
    PLASTER = 1, 6.0, 6.0
    ROOF = 2, 6.0, 6.0
    GRAVEL = 3, 8.0, 8.0
    PAVEMENT = 4, 6.0, 6.0
    GRASS = 5, 9.0, 9.0
    LEAVES = 6, 2.5, 2.5
    BARK = 7, 2.0, 2.0
    WOOD = 8, 4.0, 4.0
    GLASS = 9, 3.0, 3.0
    CARPAINT = 10, 3.0, 3.0
    DOOR = 11, 1.2, 2.2
    SIGN = 12, 0.7, 0.7
    ROAD = 13, 11.0, 24.0
    PATCHED_ROAD = 14, 11.0, 24.0
    CROSSING = 15, 11.0, 11.0
    FACADE = 16, 12.0, 12.0


@lru_cache(maxsize=4)
def town_textures(seed: int) -> tuple[Image, ...]:
    """The images indexed by ``Look``, then the facades: uint8 (512, 512, 4) each, from a seed."""
    painters: list[Painter] = [*_PAINTERS, *(partial(paint_facade, style) for style in FACADES)]
    return paint_textures(seed, 0x7E87, painters)


def _roof(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(Look.ROOF.extent, (0.75, 0.75, 0.75), 1.0)
    canvas.bricks(rng, brick=(0.375, 0.375), joint=0.05, joint_rgb=(0.35, 0.35, 0.35), spread=0.18)
    canvas.shade(0.14 * noise(rng, 0.9))
    return canvas


def _pavement(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(Look.PAVEMENT.extent, (0.62, 0.60, 0.58), 1.0)
    canvas.bricks(rng, brick=(0.75, 0.75), joint=0.03, joint_rgb=(0.38, 0.38, 0.37), spread=0.09)
    canvas.shade(0.12 * noise(rng, 0.7))
    return canvas


def _wood(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(Look.WOOD.extent, (0.72, 0.66, 0.58), 1.0)
    canvas.bricks(rng, brick=(0.125, 4.0), joint=0.03, joint_rgb=(0.18, 0.16, 0.14), spread=0.2)
    canvas.shade(0.16 * noise(rng, 0.7))
    return canvas


def _grass(rng: np.random.Generator) -> Canvas:
    canvas = rough(Look.GRASS, (0.34, 0.44, 0.20), 0.26)(rng)
    canvas.rgb[..., 0] *= 1 + 0.15 * noise(rng, 1.2)
    return canvas


def _leaves(rng: np.random.Generator) -> Canvas:
    canvas = rough(Look.LEAVES, (0.80, 0.85, 0.75), 0.38)(rng)
    canvas.shade(0.2 * noise(rng, 0.2))
    return canvas


def _door(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(Look.DOOR.extent, (0.8, 0.8, 0.8), 1.0)
    for y in (0.25, 1.2):
        canvas.rectangle((0.2, y), (0.8, 0.7), (0.6, 0.6, 0.6), 1.0)
    canvas.rectangle((1.02, 1.0), (0.08, 0.15), (0.8, 0.7, 0.3), 0.0)
    canvas.shade(0.06 * noise(rng, 0.7))
    return canvas


def _sign(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(Look.SIGN.extent, (0.95, 0.95, 0.95), 1.0)
    canvas.rectangle((0.08, 0.08), (0.54, 0.54), (0.97, 0.97, 0.97), 0.0)
    canvas.rectangle((0.28, 0.16), (0.14, 0.38), (0.1, 0.1, 0.1), 0.0)
    canvas.shade(0.03 * noise(rng, 0.7))
    return canvas


def _road(rng: np.random.Generator, patches: int) -> Canvas:
    """A street's full width: a dashed centre line, and a line beside each parking strip."""
    canvas = _asphalt(rng, Look.ROAD, patches)
    white = (0.80, 0.80, 0.78)
    for y in np.arange(1.5, 24.0, 6.0):
        canvas.rectangle((5.43, y), (0.14, 3.0), white, 0.0)
    for x in (2.0, 8.9):
        canvas.rectangle((x, 0.0), (0.1, 24.0), white, 0.0)
    for y in np.arange(0.0, 24.0, 6.0):
        canvas.rectangle((0.0, y), (2.0, 0.1), white, 0.0)
        canvas.rectangle((9.0, y), (2.0, 0.1), white, 0.0)
    canvas.shade(0.10 * noise(rng, 0.3))
    return canvas


def _asphalt(rng: np.random.Generator, look: Look, patches: int) -> Canvas:
    """Grey asphalt with repairs, stains and manholes."""
    extent = look.extent
    canvas = Canvas(extent, (0.40, 0.40, 0.41), 1.0)
    for _ in range(patches):
        corner = rng.uniform((0, 0), extent)
        size = rng.uniform((0.3, 0.4), (1.8, 4.0))
        canvas.rectangle(corner, size, (rng.uniform(0.28, 0.52),) * 3, 1.0)
    for _ in range(3):
        canvas.rectangle(rng.uniform((0, 0), extent), (0.6, 0.6), (0.22, 0.21, 0.20), 0.0)
    canvas.shade(0.17 * noise(rng, 0.55))
    return canvas


# In the order of ``Look``, without the facades.
_PAINTERS: tuple[Painter, ...] = (
    rough(Look.PLAIN, (0.9, 0.9, 0.9), 0.05),
    rough(Look.PLASTER, (0.85, 0.85, 0.85), 0.10),
    _roof,
    rough(Look.GRAVEL, (0.42, 0.42, 0.43), 0.16),
    _pavement,
    _grass,
    _leaves,
    rough(Look.BARK, (0.36, 0.30, 0.24), 0.30),
    _wood,
    rough(Look.GLASS, (0.16, 0.19, 0.22), 0.25),
    rough(Look.CARPAINT, (0.92, 0.92, 0.92), 0.06),
    _door,
    _sign,
    lambda rng: _road(rng, patches=6),
    lambda rng: _road(rng, patches=26),
    lambda rng: _asphalt(rng, Look.CROSSING, patches=8),
)
