# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Procedural indoor textures: wood, tiles, carpets, cardboard, doors and windows.

A texture is uint8 (S, S, 4): RGB and how strongly the surface's tint colours a texel, as in town.
"""

from collections.abc import Callable, Mapping
from enum import IntEnum
from functools import lru_cache

import numpy as np

from fusionslam.sim.canvas import SIDE, Canvas, Rgb, noise
from fusionslam.sim.indoor import posters
from fusionslam.sim.mesh import Paint
from fusionslam.storage.arrays import Image

GREY: Rgb = (0.62, 0.63, 0.65)
DARK: Rgb = (0.22, 0.22, 0.24)
WHITE: Rgb = (0.97, 0.97, 0.95)


class Look(IntEnum):
    """Indices of the indoor worlds' textures."""

    PLAIN = 0
    PLASTER = 1
    STRIPES = 2
    FLOWERS = 3
    WOOD = 4
    PLANKS = 5
    PARQUET = 6
    TILES = 7
    LINOLEUM = 8
    CONCRETE = 9
    CARPET = 10
    RUG = 11
    FABRIC = 12
    PLAID = 13
    CARDBOARD = 14
    CRATE = 15
    BOOKS = 16
    DOOR = 17
    CUPBOARD = 18
    DRAWERS = 19
    WINDOW = 20
    CURTAIN = 21
    CORRUGATED = 22
    SHUTTER = 23
    PANELS = 24
    LEAVES = 25
    HAZARD = 26
    SCREEN = 27
    OVEN = 28
    PICTURES = 29
    LABELS = 30


# Width and height in metres that one image covers unless it is fitted to a panel.
EXTENT: Mapping[Look, tuple[float, float]] = {
    Look.PLAIN: (1.0, 1.0),
    Look.PLASTER: (3.0, 3.0),
    Look.STRIPES: (1.2, 1.2),
    Look.FLOWERS: (1.0, 1.0),
    Look.WOOD: (0.8, 0.8),
    Look.PLANKS: (2.4, 2.4),
    Look.PARQUET: (1.6, 1.6),
    Look.TILES: (1.2, 1.2),
    Look.LINOLEUM: (2.0, 2.0),
    Look.CONCRETE: (6.0, 6.0),
    Look.CARPET: (1.0, 1.0),
    Look.RUG: (2.0, 1.4),
    Look.FABRIC: (0.5, 0.5),
    Look.PLAID: (0.8, 0.8),
    Look.CARDBOARD: (0.6, 0.5),
    Look.CRATE: (0.4, 0.3),
    Look.BOOKS: (1.0, 0.35),
    Look.DOOR: (0.9, 2.05),
    Look.CUPBOARD: (0.6, 0.9),
    Look.DRAWERS: (0.8, 0.9),
    Look.WINDOW: (1.4, 1.2),
    Look.CURTAIN: (1.0, 2.0),
    Look.CORRUGATED: (2.0, 2.0),
    Look.SHUTTER: (3.0, 3.0),
    Look.PANELS: (1.2, 1.2),
    Look.LEAVES: (0.5, 0.5),
    Look.HAZARD: (0.6, 0.6),
    Look.SCREEN: (1.0, 0.6),
    Look.OVEN: (0.6, 0.9),
    Look.PICTURES: (1.0, 1.0),
    Look.LABELS: (1.0, 1.0),
}


def paint(look: Look, tint: Rgb = (1.0, 1.0, 1.0), offset: tuple[float, float] = (0, 0)) -> Paint:
    """A texture at its natural size."""
    return Paint(int(look), tint, EXTENT[look], offset)


def fitted(look: Look, width: float, height: float, tint: Rgb = (1.0, 1.0, 1.0)) -> Paint:
    """A texture stretched so that one image covers a panel of this size in metres."""
    return Paint(int(look), tint, (width, height))


def cut(look: Look, number: int, width: float, height: float, tint: Rgb = (1, 1, 1)) -> Paint:
    """One cell of an atlas (``PICTURES`` or ``LABELS``), fitted to a panel of this size."""
    row, column = divmod(number % posters.CELLS**2, posters.CELLS)
    across = (width * posters.CELLS, height * posters.CELLS)
    return Paint(int(look), tint, across, (column / posters.CELLS, row / posters.CELLS))


@lru_cache(maxsize=4)
def indoor_textures(seed: int) -> tuple[Image, ...]:
    """The images indexed by ``Look``: uint8 (512, 512, 4) each, made from a seed."""
    return tuple(
        _PAINTERS[look](np.random.default_rng([seed, look, 0x1D00])).image() for look in Look
    )


def _rough(look: Look, rgb: Rgb, contrast: float, roughness: float = 0.7) -> Callable[..., Canvas]:
    """A painter of one colour with noise at every scale."""

    def paint_it(rng: np.random.Generator) -> Canvas:
        canvas = Canvas(EXTENT[look], rgb, 1.0)
        canvas.shade(contrast * noise(rng, roughness))
        return canvas

    return paint_it


def _stripes(rng: np.random.Generator) -> Canvas:
    canvas = _rough(Look.STRIPES, (0.92, 0.92, 0.92), 0.04)(rng)
    for x in np.arange(0, 1.2, 0.2):
        canvas.rectangle((x, 0), (0.1, 1.2), (0.99, 0.98, 0.95), 0.4)
    canvas.shade(0.03 * noise(rng, 0.6))
    return canvas


def _flowers(rng: np.random.Generator) -> Canvas:
    canvas = _rough(Look.FLOWERS, (0.93, 0.93, 0.93), 0.04)(rng)
    for x, y in [(0.25, 0.25), (0.75, 0.75), (0.75, 0.25), (0.25, 0.75)]:
        for angle in np.arange(5) * 2 * np.pi / 5:
            petal = (x + 0.06 * np.cos(angle), y + 0.06 * np.sin(angle))
            canvas.disc(petal, 0.04, (0.99, 0.97, 0.92) if x == y else (0.62, 0.62, 0.62), 0.5)
        canvas.disc((x, y), 0.03, (0.85, 0.65, 0.2), 0.0)
    return canvas


def _grain(rng: np.random.Generator, look: Look, contrast: float) -> Canvas:
    """Wood grain: streaks along y."""
    canvas = Canvas(EXTENT[look], (0.84, 0.84, 0.84), 1.0)
    streaks = noise(rng, 0.9)
    along = np.fft.irfft(np.fft.rfft(streaks, axis=0) * _low_pass(6.0)[:, None], SIDE, axis=0)
    canvas.shade((contrast * along / along.std()).astype(np.float32))
    return canvas


def _low_pass(cut_off: float) -> np.ndarray:
    weights: np.ndarray = np.exp(-((np.arange(SIDE // 2 + 1) / cut_off) ** 2))
    return weights


def _wood(rng: np.random.Generator) -> Canvas:
    return _grain(rng, Look.WOOD, 0.055)


def _planks(rng: np.random.Generator) -> Canvas:
    canvas = _grain(rng, Look.PLANKS, 0.07)
    canvas.bricks(rng, brick=(0.15, 1.2), joint=0.005, joint_rgb=(0.4, 0.38, 0.36), spread=0.14)
    return canvas


def _parquet(rng: np.random.Generator) -> Canvas:
    """Squares of five staves, alternately along and across."""
    canvas = _grain(rng, Look.PARQUET, 0.05)
    for row, column in np.ndindex(4, 4):
        for stave in range(5):
            shade = float(rng.uniform(0.70, 1.0))
            low, size = (column * 0.4, row * 0.4 + stave * 0.08), (0.395, 0.076)
            if (row + column) % 2:
                low, size = (column * 0.4 + stave * 0.08, row * 0.4), (0.076, 0.395)
            canvas.rectangle(low, size, (shade, shade, shade), 1.0)
    canvas.shade(0.05 * noise(rng, 0.5))
    return canvas


def _tiles(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(EXTENT[Look.TILES], (0.94, 0.94, 0.94), 1.0)
    canvas.bricks(rng, brick=(0.3, 0.3), joint=0.008, joint_rgb=(0.55, 0.55, 0.54), spread=0.05)
    canvas.shade(0.03 * noise(rng, 0.8))
    return canvas


def _linoleum(rng: np.random.Generator) -> Canvas:
    canvas = _rough(Look.LINOLEUM, (0.86, 0.86, 0.86), 0.04)(rng)
    speckles = noise(rng, 0.25)
    canvas.rgb[speckles > 2.0] *= 0.72
    canvas.rgb[speckles < -2.0] = 0.97
    return canvas


def _concrete(rng: np.random.Generator) -> Canvas:
    """Stained slabs with joints every three metres."""
    canvas = _rough(Look.CONCRETE, (0.62, 0.62, 0.61), 0.07)(rng)
    canvas.shade(0.08 * noise(rng, 1.5))
    for at in (0.0, 3.0):
        canvas.rectangle((at, 0), (0.02, 6), (0.36, 0.36, 0.35), 1.0)
        canvas.rectangle((0, at), (6, 0.02), (0.36, 0.36, 0.35), 1.0)
    for _ in range(14):
        spot = rng.uniform(0.5, 5.5, 2)
        canvas.disc(spot, rng.uniform(0.02, 0.14), (rng.uniform(0.38, 0.56),) * 3, 1.0)
    canvas.shade(0.05 * noise(rng, 0.3))
    return canvas


def _rug(rng: np.random.Generator) -> Canvas:
    """A carpet with a border and diamonds."""
    canvas = Canvas(EXTENT[Look.RUG], (0.85, 0.85, 0.85), 1.0)
    canvas.rectangle((0.06, 0.06), (1.88, 1.28), (0.93, 0.88, 0.72), 0.2)
    canvas.rectangle((0.14, 0.14), (1.72, 1.12), (0.70, 0.70, 0.70), 1.0)
    for x in np.arange(0.36, 1.8, 0.32):
        for half in np.arange(0.14, 0.02, -0.02):
            rgb = (0.95, 0.9, 0.75) if round(half / 0.02) % 2 else (0.25, 0.22, 0.25)
            height = 3.0 * half
            canvas.rectangle((x - half, 0.7 - height / 2), (2 * half, height), rgb, 0.3)
    canvas.shade(0.12 * noise(rng, 0.2))
    return canvas


def _plaid(rng: np.random.Generator) -> Canvas:
    canvas = _rough(Look.PLAID, (0.9, 0.9, 0.9), 0.07, 0.3)(rng)
    for at, width, factor in ((0.05, 0.1, 0.6), (0.25, 0.04, 1.15), (0.45, 0.1, 0.6)):
        low, high = (int(edge / 0.8 * SIDE) for edge in (at, at + width))
        canvas.rgb[:, low:high] *= factor
        canvas.rgb[low:high] *= factor
    return canvas


def _cardboard(rng: np.random.Generator) -> Canvas:
    canvas = _rough(Look.CARDBOARD, (0.74, 0.58, 0.40), 0.05)(rng)
    canvas.rectangle((0.0, 0.0), (0.6, 0.008), (0.42, 0.32, 0.2), 1.0)
    canvas.rectangle((0.0, 0.0), (0.006, 0.5), (0.42, 0.32, 0.2), 1.0)
    canvas.rectangle((0.26, 0.0), (0.07, 0.5), (0.82, 0.72, 0.52), 0.6)
    canvas.rectangle((0.04, 0.28), (0.18, 0.13), (0.95, 0.95, 0.93), 0.0)
    for x in np.arange(0.055, 0.2, 0.012):
        canvas.rectangle((x, 0.3), (rng.uniform(0.002, 0.008), 0.05), (0.1, 0.1, 0.1), 0.0)
    canvas.rectangle((0.055, 0.375), (0.1, 0.02), (0.2, 0.2, 0.2), 0.0)
    canvas.rectangle((0.42, 0.06), (0.12, 0.1), (0.45, 0.3, 0.18), 0.8)
    return canvas


def _crate(rng: np.random.Generator) -> Canvas:
    canvas = _rough(Look.CRATE, (0.9, 0.9, 0.9), 0.04)(rng)
    for x in np.arange(0.02, 0.38, 0.06):
        canvas.rectangle((x, 0.06), (0.035, 0.16), (0.5, 0.5, 0.5), 1.0)
    canvas.rectangle((0.0, 0.0), (0.4, 0.012), (0.4, 0.4, 0.4), 1.0)
    canvas.rectangle((0.14, 0.245), (0.12, 0.03), (0.25, 0.25, 0.25), 1.0)
    return canvas


def _books(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(EXTENT[Look.BOOKS], (0.12, 0.10, 0.09), 0.0)
    x = 0.0
    while x < 0.94:
        width, height = rng.uniform(0.018, 0.055), rng.uniform(0.2, 0.33)
        rgb = rng.uniform(0.12, 0.95, 3)
        canvas.rectangle((x, 0), (width, height), rgb, 0.0)
        canvas.rectangle((x + 0.004, 0.7 * height), (width - 0.008, 0.02), 1.0 - 0.6 * rgb, 0.0)
        x += width + (0.06 if rng.random() < 0.1 else 0.003)
    return canvas


def _door(rng: np.random.Generator) -> Canvas:
    canvas = _grain(rng, Look.DOOR, 0.05)
    for y in (0.2, 1.15):
        canvas.rectangle((0.15, y), (0.6, 0.7), (0.66, 0.66, 0.66), 1.0)
        canvas.rectangle((0.18, y + 0.03), (0.54, 0.64), (0.84, 0.84, 0.84), 1.0)
    canvas.rectangle((0.78, 0.98), (0.09, 0.03), (0.55, 0.55, 0.58), 0.0)
    canvas.rectangle((0.0, 0.0), (0.9, 0.12), (0.6, 0.6, 0.6), 1.0)
    return canvas


def _cupboard(rng: np.random.Generator) -> Canvas:
    canvas = _grain(rng, Look.CUPBOARD, 0.05)
    canvas.rectangle((0.0, 0.0), (0.6, 0.09), (0.3, 0.3, 0.3), 1.0)
    canvas.rectangle((0.0, 0.0), (0.006, 0.9), (0.3, 0.3, 0.3), 1.0)
    canvas.rectangle((0.06, 0.15), (0.48, 0.68), (0.78, 0.78, 0.78), 1.0)
    canvas.rectangle((0.5, 0.55), (0.015, 0.14), (0.3, 0.3, 0.32), 0.0)
    return canvas


def _drawers(rng: np.random.Generator) -> Canvas:
    canvas = _grain(rng, Look.DRAWERS, 0.05)
    for y in (0.0, 0.3, 0.6):
        canvas.rectangle((0.0, y), (0.8, 0.012), (0.25, 0.25, 0.25), 1.0)
        canvas.rectangle((0.33, y + 0.15), (0.14, 0.02), (0.3, 0.3, 0.32), 0.0)
    return canvas


def _window(rng: np.random.Generator) -> Canvas:
    """A window view: sky, trees and a lawn behind two panes."""
    canvas = Canvas(EXTENT[Look.WINDOW], (0.72, 0.85, 0.97), 0.0)
    canvas.rectangle((0, 0), (1.4, 0.3), (0.48, 0.62, 0.34), 0.0)
    for _ in range(16):
        at = (rng.uniform(0, 1.4), rng.uniform(0.3, 0.55))
        rgb = np.array((0.28, 0.44, 0.22)) * rng.uniform(0.7, 1.4)
        canvas.disc(at, rng.uniform(0.06, 0.16), rgb, 0.0)
    canvas.shade(0.06 * noise(rng, 0.8))
    for x in (0.0, 0.67, 1.34):
        canvas.rectangle((x, 0), (0.06, 1.2), (0.96, 0.96, 0.95), 1.0)
    for y in (0.0, 1.14):
        canvas.rectangle((0, y), (1.4, 0.06), (0.96, 0.96, 0.95), 1.0)
    return canvas


def _waves(
    look: Look, count: int, depth: float, *, upright: bool, noisy: float = 0.04
) -> Callable[..., Canvas]:
    """A painter of ``count`` folds or ribs, repeated along x, or along y if not upright."""

    def paint_it(rng: np.random.Generator) -> Canvas:
        canvas = _rough(look, (0.88, 0.88, 0.88), noisy)(rng)
        wave = depth * np.sin(np.arange(SIDE) * 2 * np.pi * count / SIDE).astype(np.float32)
        canvas.shade(np.tile(wave, (SIDE, 1)) if upright else np.tile(wave[:, None], (1, SIDE)))
        return canvas

    return paint_it


def _panels(rng: np.random.Generator) -> Canvas:
    """Panels of a suspended ceiling."""
    canvas = _rough(Look.PANELS, (0.97, 0.97, 0.96), 0.03, 0.3)(rng)
    for at in (0.0, 0.6):
        canvas.rectangle((at, 0), (0.02, 1.2), (0.75, 0.75, 0.75), 1.0)
        canvas.rectangle((0, at), (1.2, 0.02), (0.75, 0.75, 0.75), 1.0)
    return canvas


def _hazard(rng: np.random.Generator) -> Canvas:
    """Black and yellow hazard stripes at 45 degrees."""
    canvas = _rough(Look.HAZARD, (0.95, 0.78, 0.10), 0.05)(rng)
    steps = np.add.outer(np.arange(SIDE), np.arange(SIDE)) * 4 // SIDE
    canvas.rgb[steps % 2 == 1] = (0.10, 0.10, 0.11)
    canvas.tint[:] = 0.0
    return canvas


def _screen(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(EXTENT[Look.SCREEN], (0.05, 0.05, 0.06), 0.0)
    canvas.rectangle((0.03, 0.03), (0.94, 0.54), (0.10, 0.12, 0.16), 0.0)
    canvas.shade(0.25 * noise(rng, 1.3))
    return canvas


def _oven(rng: np.random.Generator) -> Canvas:
    canvas = _rough(Look.OVEN, (0.82, 0.83, 0.84), 0.04)(rng)
    canvas.rectangle((0.05, 0.14), (0.5, 0.46), (0.08, 0.08, 0.09), 0.0)
    canvas.rectangle((0.06, 0.64), (0.48, 0.025), (0.4, 0.4, 0.42), 0.0)
    for x in (0.1, 0.22, 0.34, 0.46):
        canvas.disc((x + 0.02, 0.8), 0.028, (0.15, 0.15, 0.16), 0.0)
    return canvas


_PAINTERS: Mapping[Look, Callable[[np.random.Generator], Canvas]] = {
    Look.PLAIN: _rough(Look.PLAIN, (0.92, 0.92, 0.92), 0.03),
    Look.PLASTER: _rough(Look.PLASTER, (0.94, 0.94, 0.94), 0.035),
    Look.STRIPES: _stripes,
    Look.FLOWERS: _flowers,
    Look.WOOD: _wood,
    Look.PLANKS: _planks,
    Look.PARQUET: _parquet,
    Look.TILES: _tiles,
    Look.LINOLEUM: _linoleum,
    Look.CONCRETE: _concrete,
    Look.CARPET: _rough(Look.CARPET, (0.85, 0.85, 0.85), 0.14, 0.25),
    Look.RUG: _rug,
    Look.FABRIC: _waves(Look.FABRIC, 32, 0.08, upright=False, noisy=0.08),
    Look.PLAID: _plaid,
    Look.CARDBOARD: _cardboard,
    Look.CRATE: _crate,
    Look.BOOKS: _books,
    Look.DOOR: _door,
    Look.CUPBOARD: _cupboard,
    Look.DRAWERS: _drawers,
    Look.WINDOW: _window,
    Look.CURTAIN: _waves(Look.CURTAIN, 9, 0.22, upright=True),
    Look.CORRUGATED: _waves(Look.CORRUGATED, 12, 0.12, upright=True),
    Look.SHUTTER: _waves(Look.SHUTTER, 24, 0.12, upright=False),
    Look.PANELS: _panels,
    Look.LEAVES: _rough(Look.LEAVES, (0.80, 0.85, 0.75), 0.35),
    Look.HAZARD: _hazard,
    Look.SCREEN: _screen,
    Look.OVEN: _oven,
    Look.PICTURES: lambda rng: posters.pictures(rng),
    Look.LABELS: lambda rng: posters.labels(),
}
