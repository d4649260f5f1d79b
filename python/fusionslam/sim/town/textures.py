# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Small procedural images for walls, streets, leaves and cars.

A texture is uint8 (S, S, 4): RGB and how strongly the surface's tint colours that texel (255:
fully; so one brick wall serves red and yellow houses while its windows stay the same). All
textures repeat seamlessly and have contrast at every scale, which stereo matching needs.
"""

from collections.abc import Callable
from enum import IntEnum
from functools import lru_cache

import numpy as np

from fusionslam.sim.canvas import Canvas, noise
from fusionslam.sim.town.facades import FACADES, paint_facade
from fusionslam.storage.arrays import Image


class Look(IntEnum):
    """Indices of the town's textures; facades start at ``Look.FACADE``."""

    PLAIN = 0
    PLASTER = 1
    ROOF = 2
    GRAVEL = 3
    PAVEMENT = 4
    GRASS = 5
    LEAVES = 6
    BARK = 7
    WOOD = 8
    GLASS = 9
    CARPAINT = 10
    DOOR = 11
    SIGN = 12
    ROAD = 13
    PATCHED_ROAD = 14
    CROSSING = 15
    FACADE = 16


FACADE_COUNT = len(FACADES)

# Width and height in metres that one image covers.
EXTENT: dict[Look, tuple[float, float]] = {
    Look.PLAIN: (2.0, 2.0),
    Look.PLASTER: (6.0, 6.0),
    Look.ROOF: (6.0, 6.0),
    Look.GRAVEL: (8.0, 8.0),
    Look.PAVEMENT: (6.0, 6.0),
    Look.GRASS: (9.0, 9.0),
    Look.LEAVES: (2.5, 2.5),
    Look.BARK: (2.0, 2.0),
    Look.WOOD: (4.0, 4.0),
    Look.GLASS: (3.0, 3.0),
    Look.CARPAINT: (3.0, 3.0),
    Look.DOOR: (1.2, 2.2),
    Look.SIGN: (0.7, 0.7),
    Look.ROAD: (11.0, 24.0),
    Look.PATCHED_ROAD: (11.0, 24.0),
    Look.CROSSING: (11.0, 11.0),
    Look.FACADE: (12.0, 12.0),
}


@lru_cache(maxsize=4)
def town_textures(seed: int) -> tuple[Image, ...]:
    """The images indexed by ``Look``, then the facades: uint8 (512, 512, 4) each, from a seed."""
    painters: dict[Look, Callable[[np.random.Generator], Canvas]] = {
        Look.PLAIN: lambda rng: _rough(rng, (0.9, 0.9, 0.9), 0.05),
        Look.PLASTER: lambda rng: _rough(rng, (0.85, 0.85, 0.85), 0.10),
        Look.ROOF: _roof,
        Look.GRAVEL: lambda rng: _rough(rng, (0.42, 0.42, 0.43), 0.16),
        Look.PAVEMENT: _pavement,
        Look.GRASS: _grass,
        Look.LEAVES: _leaves,
        Look.BARK: lambda rng: _rough(rng, (0.36, 0.30, 0.24), 0.30),
        Look.WOOD: _wood,
        Look.GLASS: lambda rng: _rough(rng, (0.16, 0.19, 0.22), 0.25),
        Look.CARPAINT: lambda rng: _rough(rng, (0.92, 0.92, 0.92), 0.06),
        Look.DOOR: _door,
        Look.SIGN: _sign,
        Look.ROAD: lambda rng: _road(rng, patches=6),
        Look.PATCHED_ROAD: lambda rng: _road(rng, patches=26),
        Look.CROSSING: lambda rng: _asphalt(rng, EXTENT[Look.CROSSING], patches=8),
    }
    plain = [paint(_generator(seed, look)).image() for look, paint in painters.items()]
    walls = [
        paint_facade(style, _generator(seed, Look.FACADE + k)).image()
        for k, style in enumerate(FACADES)
    ]
    return tuple(plain + walls)


def _generator(seed: int, number: int) -> np.random.Generator:
    return np.random.default_rng([seed, number, 0x7E87])


def _rough(
    rng: np.random.Generator, rgb: tuple[float, float, float], contrast: float, tint: float = 1.0
) -> Canvas:
    """One colour with noise at every scale."""
    canvas = Canvas((1.0, 1.0), rgb, tint)
    canvas.shade(contrast * noise(rng, 0.7))
    return canvas


def _roof(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(EXTENT[Look.ROOF], (0.75, 0.75, 0.75), 1.0)
    canvas.bricks(rng, brick=(0.375, 0.375), joint=0.05, joint_rgb=(0.35, 0.35, 0.35), spread=0.18)
    canvas.shade(0.14 * noise(rng, 0.9))
    return canvas


def _pavement(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(EXTENT[Look.PAVEMENT], (0.62, 0.60, 0.58), 1.0)
    canvas.bricks(rng, brick=(0.75, 0.75), joint=0.03, joint_rgb=(0.38, 0.38, 0.37), spread=0.09)
    canvas.shade(0.12 * noise(rng, 0.7))
    return canvas


def _grass(rng: np.random.Generator) -> Canvas:
    canvas = _rough(rng, (0.34, 0.44, 0.20), 0.26)
    canvas.rgb[..., 0] *= 1 + 0.15 * noise(rng, 1.2)
    return canvas


def _leaves(rng: np.random.Generator) -> Canvas:
    canvas = _rough(rng, (0.80, 0.85, 0.75), 0.38)
    canvas.shade(0.2 * noise(rng, 0.2))
    return canvas


def _wood(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(EXTENT[Look.WOOD], (0.72, 0.66, 0.58), 1.0)
    canvas.bricks(rng, brick=(0.125, 4.0), joint=0.03, joint_rgb=(0.18, 0.16, 0.14), spread=0.2)
    canvas.shade(0.16 * noise(rng, 0.7))
    return canvas


def _door(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(EXTENT[Look.DOOR], (0.8, 0.8, 0.8), 1.0)
    for y in (0.25, 1.2):
        canvas.rectangle((0.2, y), (0.8, 0.7), (0.6, 0.6, 0.6), 1.0)
    canvas.rectangle((1.02, 1.0), (0.08, 0.15), (0.8, 0.7, 0.3), 0.0)
    canvas.shade(0.06 * noise(rng, 0.7))
    return canvas


def _sign(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(EXTENT[Look.SIGN], (0.95, 0.95, 0.95), 1.0)
    canvas.rectangle((0.08, 0.08), (0.54, 0.54), (0.97, 0.97, 0.97), 0.0)
    canvas.rectangle((0.28, 0.16), (0.14, 0.38), (0.1, 0.1, 0.1), 0.0)
    canvas.shade(0.03 * noise(rng, 0.7))
    return canvas


def _road(rng: np.random.Generator, patches: int) -> Canvas:
    """A street's full width: a dashed centre line, and a line beside each parking strip."""
    canvas = _asphalt(rng, EXTENT[Look.ROAD], patches)
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


def _asphalt(rng: np.random.Generator, extent: tuple[float, float], patches: int) -> Canvas:
    """Grey asphalt with repairs, stains and manholes."""
    canvas = Canvas(extent, (0.40, 0.40, 0.41), 1.0)
    for _ in range(patches):
        corner = rng.uniform((0, 0), extent)
        size = rng.uniform((0.3, 0.4), (1.8, 4.0))
        canvas.rectangle(corner, size, (rng.uniform(0.28, 0.52),) * 3, 1.0)
    for _ in range(3):
        canvas.rectangle(rng.uniform((0, 0), extent), (0.6, 0.6), (0.22, 0.21, 0.20), 0.0)
    canvas.shade(0.17 * noise(rng, 0.55))
    return canvas
