# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The indoor worlds' textures: wood, tiles, carpets, cardboard, doors and windows."""

from collections.abc import Mapping
from functools import lru_cache, partial

import numpy as np

from fusionslam.sim.canvas import SIDE, Canvas, Painter, noise, paint_textures, rough
from fusionslam.sim.indoor import posters
from fusionslam.sim.mesh import Paint, Rgb, Texture
from fusionslam.storage.arrays import Image

GREY: Rgb = (0.62, 0.63, 0.65)
DARK: Rgb = (0.22, 0.22, 0.24)
WHITE: Rgb = (0.97, 0.97, 0.95)
STEEL: Rgb = (0.78, 0.80, 0.82)
BLUE: Rgb = (0.16, 0.30, 0.62)
TIMBER: Rgb = (0.86, 0.70, 0.48)


class Look(Texture):
    """The indoor worlds' textures, each with the size in metres of an image that is not fitted."""

    PLAIN = 0, 1.0, 1.0
    PLASTER = 1, 3.0, 3.0
    STRIPES = 2, 1.2, 1.2
    FLOWERS = 3, 1.0, 1.0
    WOOD = 4, 0.8, 0.8
    PLANKS = 5, 2.4, 2.4
    PARQUET = 6, 1.6, 1.6
    TILES = 7, 1.2, 1.2
    LINOLEUM = 8, 2.0, 2.0
    CONCRETE = 9, 6.0, 6.0
    CARPET = 10, 1.0, 1.0
    RUG = 11, 2.0, 1.4
    FABRIC = 12, 0.5, 0.5
    PLAID = 13, 0.8, 0.8
    CARDBOARD = 14, 0.6, 0.5
    CRATE = 15, 0.4, 0.3
    BOOKS = 16, 1.0, 0.35
    DOOR = 17, 0.9, 2.05
    CUPBOARD = 18, 0.6, 0.9
    DRAWERS = 19, 0.8, 0.9
    WINDOW = 20, 1.4, 1.2
    CURTAIN = 21, 1.0, 2.0
    CORRUGATED = 22, 2.0, 2.0
    SHUTTER = 23, 3.0, 3.0
    PANELS = 24, 1.2, 1.2
    LEAVES = 25, 0.5, 0.5
    HAZARD = 26, 0.6, 0.6
    SCREEN = 27, 1.0, 0.6
    OVEN = 28, 0.6, 0.9
    PICTURES = 29, 1.0, 1.0
    LABELS = 30, 1.0, 1.0


def fit(look: Look, width: float, height: float, tint: Rgb = (1.0, 1.0, 1.0)) -> Paint:
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
    return paint_textures(seed, 0x1D00, (_PAINTERS[look] for look in Look))


def _stripes(rng: np.random.Generator) -> Canvas:
    canvas = rough(Look.STRIPES, (0.92, 0.92, 0.92), 0.04)(rng)
    for x in np.arange(0, 1.2, 0.2):
        canvas.rectangle((x, 0), (0.1, 1.2), (0.99, 0.98, 0.95), 0.4)
    canvas.shade(0.03 * noise(rng, 0.6))
    return canvas


def _flowers(rng: np.random.Generator) -> Canvas:
    canvas = rough(Look.FLOWERS, (0.93, 0.93, 0.93), 0.04)(rng)
    for x, y in [(0.25, 0.25), (0.75, 0.75), (0.75, 0.25), (0.25, 0.75)]:
        for angle in np.arange(5) * 2 * np.pi / 5:
            petal = (x + 0.06 * np.cos(angle), y + 0.06 * np.sin(angle))
            canvas.disc(petal, 0.04, (0.99, 0.97, 0.92) if x == y else (0.62, 0.62, 0.62), 0.5)
        canvas.disc((x, y), 0.03, (0.85, 0.65, 0.2), 0.0)
    return canvas


def _grain(rng: np.random.Generator, look: Look, contrast: float) -> Canvas:
    """Wood grain: streaks along y."""
    canvas = Canvas(look.extent, (0.84, 0.84, 0.84), 1.0)
    streaks = noise(rng, 0.9)
    low_pass = np.exp(-((np.arange(SIDE // 2 + 1) / 6.0) ** 2))
    along = np.fft.irfft(np.fft.rfft(streaks, axis=0) * low_pass[:, None], SIDE, axis=0)
    canvas.shade((contrast * along / along.std()).astype(np.float32))
    return canvas


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
    canvas = Canvas(Look.TILES.extent, (0.94, 0.94, 0.94), 1.0)
    canvas.bricks(rng, brick=(0.3, 0.3), joint=0.008, joint_rgb=(0.55, 0.55, 0.54), spread=0.05)
    canvas.shade(0.03 * noise(rng, 0.8))
    return canvas


def _linoleum(rng: np.random.Generator) -> Canvas:
    canvas = rough(Look.LINOLEUM, (0.86, 0.86, 0.86), 0.04)(rng)
    speckles = noise(rng, 0.25)
    canvas.rgb[speckles > 2.0] *= 0.72
    canvas.rgb[speckles < -2.0] = 0.97
    return canvas


def _concrete(rng: np.random.Generator) -> Canvas:
    """Stained slabs with joints every three metres."""
    canvas = rough(Look.CONCRETE, (0.62, 0.62, 0.61), 0.07)(rng)
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
    canvas = Canvas(Look.RUG.extent, (0.85, 0.85, 0.85), 1.0)
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
    canvas = rough(Look.PLAID, (0.9, 0.9, 0.9), 0.07, 0.3)(rng)
    for at, width, factor in ((0.05, 0.1, 0.6), (0.25, 0.04, 1.15), (0.45, 0.1, 0.6)):
        low, high = (int(edge / 0.8 * SIDE) for edge in (at, at + width))
        canvas.rgb[:, low:high] *= factor
        canvas.rgb[low:high] *= factor
    return canvas


def _cardboard(rng: np.random.Generator) -> Canvas:
    canvas = rough(Look.CARDBOARD, (0.74, 0.58, 0.40), 0.05)(rng)
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
    canvas = rough(Look.CRATE, (0.9, 0.9, 0.9), 0.04)(rng)
    for x in np.arange(0.02, 0.38, 0.06):
        canvas.rectangle((x, 0.06), (0.035, 0.16), (0.5, 0.5, 0.5), 1.0)
    canvas.rectangle((0.0, 0.0), (0.4, 0.012), (0.4, 0.4, 0.4), 1.0)
    canvas.rectangle((0.14, 0.245), (0.12, 0.03), (0.25, 0.25, 0.25), 1.0)
    return canvas


def _books(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(Look.BOOKS.extent, (0.12, 0.10, 0.09), 0.0)
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
    canvas = Canvas(Look.WINDOW.extent, (0.72, 0.85, 0.97), 0.0)
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


def _waves(look: Look, count: int, depth: float, *, upright: bool, noisy: float = 0.04) -> Painter:
    """A painter of ``count`` folds or ribs, repeated along x, or along y if not upright."""

    def paint_it(rng: np.random.Generator) -> Canvas:
        canvas = rough(look, (0.88, 0.88, 0.88), noisy)(rng)
        wave = depth * np.sin(np.arange(SIDE) * 2 * np.pi * count / SIDE).astype(np.float32)
        canvas.shade(np.tile(wave, (SIDE, 1)) if upright else np.tile(wave[:, None], (1, SIDE)))
        return canvas

    return paint_it


def _panels(rng: np.random.Generator) -> Canvas:
    """Panels of a suspended ceiling."""
    canvas = rough(Look.PANELS, (0.97, 0.97, 0.96), 0.03, 0.3)(rng)
    for at in (0.0, 0.6):
        canvas.rectangle((at, 0), (0.02, 1.2), (0.75, 0.75, 0.75), 1.0)
        canvas.rectangle((0, at), (1.2, 0.02), (0.75, 0.75, 0.75), 1.0)
    return canvas


def _hazard(rng: np.random.Generator) -> Canvas:
    """Black and yellow hazard stripes at 45 degrees."""
    canvas = rough(Look.HAZARD, (0.95, 0.78, 0.10), 0.05)(rng)
    steps = np.add.outer(np.arange(SIDE), np.arange(SIDE)) * 4 // SIDE
    canvas.rgb[steps % 2 == 1] = (0.10, 0.10, 0.11)
    canvas.tint[:] = 0.0
    return canvas


def _screen(rng: np.random.Generator) -> Canvas:
    canvas = Canvas(Look.SCREEN.extent, (0.05, 0.05, 0.06), 0.0)
    canvas.rectangle((0.03, 0.03), (0.94, 0.54), (0.10, 0.12, 0.16), 0.0)
    canvas.shade(0.25 * noise(rng, 1.3))
    return canvas


def _oven(rng: np.random.Generator) -> Canvas:
    canvas = rough(Look.OVEN, (0.82, 0.83, 0.84), 0.04)(rng)
    canvas.rectangle((0.05, 0.14), (0.5, 0.46), (0.08, 0.08, 0.09), 0.0)
    canvas.rectangle((0.06, 0.64), (0.48, 0.025), (0.4, 0.4, 0.42), 0.0)
    for x in (0.1, 0.22, 0.34, 0.46):
        canvas.disc((x + 0.02, 0.8), 0.028, (0.15, 0.15, 0.16), 0.0)
    return canvas


_PAINTERS: Mapping[Look, Painter] = {
    Look.PLAIN: rough(Look.PLAIN, (0.92, 0.92, 0.92), 0.03),
    Look.PLASTER: rough(Look.PLASTER, (0.94, 0.94, 0.94), 0.035),
    Look.STRIPES: _stripes,
    Look.FLOWERS: _flowers,
    Look.WOOD: partial(_grain, look=Look.WOOD, contrast=0.055),
    Look.PLANKS: _planks,
    Look.PARQUET: _parquet,
    Look.TILES: _tiles,
    Look.LINOLEUM: _linoleum,
    Look.CONCRETE: _concrete,
    Look.CARPET: rough(Look.CARPET, (0.85, 0.85, 0.85), 0.14, 0.25),
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
    Look.LEAVES: rough(Look.LEAVES, (0.80, 0.85, 0.75), 0.35),
    Look.HAZARD: _hazard,
    Look.SCREEN: _screen,
    Look.OVEN: _oven,
    Look.PICTURES: posters.pictures,
    Look.LABELS: lambda rng: posters.labels(),
}
