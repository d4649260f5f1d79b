# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The indoor worlds' textures: wood, tiles, carpets, cardboard, doors, windows, pictures."""

from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from fusionslam.base.arrays import Floats, Image
from fusionslam.sim.canvas import SIDE, Canvas, follow, paint_textures, read_table
from fusionslam.sim.mesh import Paint, Rgb, Texture

# A sheet of pictures or numbers holds CELLS x CELLS, numbered from the lower left, row by row.
CELLS = 4
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
    PICTURES = 29, 4.0, 4.0
    LABELS = 30, 4.0, 4.0


def fit(look: Look, width: float, height: float, tint: Rgb = (1.0, 1.0, 1.0)) -> Paint:
    """A texture stretched so that one image covers a panel of this size in metres."""
    return Paint(int(look), tint, (width, height))


def cut(look: Look, number: int, width: float, height: float, tint: Rgb = (1, 1, 1)) -> Paint:
    """One cell of an atlas (``PICTURES`` or ``LABELS``), fitted to a panel of this size."""
    row, column = divmod(number % CELLS**2, CELLS)
    across = (width * CELLS, height * CELLS)
    return Paint(int(look), tint, across, (column / CELLS, row / CELLS))


@lru_cache(maxsize=4)
def indoor_textures(seed: int) -> tuple[Image, ...]:
    """The images indexed by ``Look``: uint8 (512, 512, 4) each, made from a seed."""
    steps = read_table(Path(__file__).with_suffix(".yaml"))

    def paint(look: Look, rng: np.random.Generator) -> Canvas:
        canvas = IndoorCanvas(look.extent, rng)
        follow(canvas, steps[look.name.lower()])
        return canvas

    return paint_textures(seed, 0x1D00, (partial(paint, look) for look in Look))


class IndoorCanvas(Canvas):
    """A canvas for what homes, wards and halls are covered with."""

    def grain(self, contrast: float) -> None:
        """Wood grain: streaks along y."""
        self.fill((0.84, 0.84, 0.84), 1.0)
        streaks = self.noise(0.9)
        low_pass = np.exp(-((np.arange(SIDE // 2 + 1) / 6.0) ** 2))
        along = np.fft.irfft(np.fft.rfft(streaks, axis=0) * low_pass[:, None], SIDE, axis=0)
        self.brighten((contrast * along / along.std()).astype(np.float32))

    def waves(self, count: int, depth: float, *, upright: bool) -> None:
        """Folds or ribs, repeated along x, or along y if not upright."""
        wave = depth * np.sin(np.arange(SIDE) * 2 * np.pi * count / SIDE).astype(np.float32)
        self.brighten(np.tile(wave, (SIDE, 1)) if upright else np.tile(wave[:, None], (1, SIDE)))

    def bands(self, start: float, width: float, factor: float) -> None:
        """A band in each direction, brighter or darker by a factor."""
        low, high = (int(edge / self.extent[0] * SIDE) for edge in (start, start + width))
        self.rgb[:, low:high] *= factor
        self.rgb[low:high] *= factor

    def diagonals(self, rgb: Rgb) -> None:
        """Stripes at 45 degrees, which take no tint."""
        steps = np.add.outer(np.arange(SIDE), np.arange(SIDE)) * 4 // SIDE
        self.rgb[steps % 2 == 1] = rgb
        self.tint[:] = 0.0

    def flower(self, centre: tuple[float, float], rgb: Rgb) -> None:
        """Five petals."""
        x, y = centre
        for angle in np.arange(5) * 2 * np.pi / 5:
            self.disc((x + 0.06 * np.cos(angle), y + 0.06 * np.sin(angle)), 0.04, rgb, 0.5)
        self.disc(centre, 0.03, (0.85, 0.65, 0.2), 0.0)

    def staves(self) -> None:
        """Squares of five staves, alternately along and across."""
        for row, column in np.ndindex(4, 4):
            for stave in range(5):
                shade = float(self.rng.uniform(0.70, 1.0))
                low, size = (column * 0.4, row * 0.4 + stave * 0.08), (0.395, 0.076)
                if (row + column) % 2:
                    low, size = (column * 0.4 + stave * 0.08, row * 0.4), (0.076, 0.395)
                self.rectangle(low, size, (shade, shade, shade), 1.0)

    def speckles(self) -> None:
        """Dark and light flakes."""
        speckles = self.noise(0.25)
        self.rgb[speckles > 2.0] *= 0.72
        self.rgb[speckles < -2.0] = 0.97

    def stains(self, count: int) -> None:
        """Round grey spots."""
        for _ in range(count):
            spot = self.rng.uniform(0.5, 5.5, 2)
            radius, grey = self.rng.uniform(0.02, 0.14), self.rng.uniform(0.38, 0.56)
            self.disc(spot, radius, (grey,) * 3, 1.0)

    def diamonds(self) -> None:
        """A row of nested diamonds."""
        for x in np.arange(0.36, 1.8, 0.32):
            for half in np.arange(0.14, 0.02, -0.02):
                rgb = (0.95, 0.9, 0.75) if round(half / 0.02) % 2 else (0.25, 0.22, 0.25)
                height = 3.0 * half
                self.rectangle((x - half, 0.7 - height / 2), (2 * half, height), rgb, 0.3)

    def bar_code(self) -> None:
        """Bars of random width."""
        for x in np.arange(0.055, 0.2, 0.012):
            bar = (self.rng.uniform(0.002, 0.008), 0.05)
            self.rectangle((x, 0.3), bar, (0.1, 0.1, 0.1), 0.0)

    def books(self) -> None:
        """Backs of books, with gaps."""
        x = 0.0
        while x < 0.94:
            width, height = self.rng.uniform(0.018, 0.055), self.rng.uniform(0.2, 0.33)
            rgb = self.rng.uniform(0.12, 0.95, 3)
            self.rectangle((x, 0), (width, height), rgb, 0.0)
            self.rectangle((x + 0.004, 0.7 * height), (width - 0.008, 0.02), 1.0 - 0.6 * rgb, 0.0)
            x += width + (0.06 if self.rng.random() < 0.1 else 0.003)

    def trees(self, count: int) -> None:
        """Round green crowns at the horizon."""
        for _ in range(count):
            at = (self.rng.uniform(0, 1.4), self.rng.uniform(0.3, 0.55))
            rgb = np.array((0.28, 0.44, 0.22)) * self.rng.uniform(0.7, 1.4)
            self.disc(at, self.rng.uniform(0.06, 0.16), rgb, 0.0)

    def pictures(self) -> None:
        """Landscapes, discs and blocks, no two of the same colours."""
        order = self.rng.permutation(len(_COLOURS))
        makers = (self._landscape, self._discs, self._blocks)
        for number, (row, column) in enumerate(np.ndindex(CELLS, CELLS)):
            low = np.array((column + 0.07, row + 0.07))
            first, second = (
                _COLOURS[order[(number + k) % len(order)]] for k in (0, 1 + number // 12)
            )
            self.rectangle(low, (0.86, 0.86), first, 0.0)
            makers[number % 3](low, np.asarray(second))

    def _landscape(self, low: Floats, rgb: Floats) -> None:
        skyline = 0.25 + 0.15 * self.rng.random() + 0.1 * np.cumsum(self.rng.uniform(-0.5, 0.5, 20))
        for k, height in enumerate(np.clip(skyline, 0.1, 0.6)):
            self.rectangle(np.add(low, (0.043 * k, 0)), (0.043, height), rgb, 0.0)
        self.disc(np.add(low, (self.rng.uniform(0.2, 0.7), 0.7)), 0.09, (0.97, 0.93, 0.75), 0.0)

    def _discs(self, low: Floats, rgb: Floats) -> None:
        for radius, factor in ((0.36, 1.0), (0.26, 0.6), (0.15, 1.3)):
            middle = low + 0.43 + self.rng.uniform(-0.05, 0.05, 2)
            self.disc(middle, radius, np.clip(rgb * factor, 0, 1), 0.0)

    def _blocks(self, low: Floats, rgb: Floats) -> None:
        for _ in range(6):
            size = self.rng.uniform(0.1, 0.45, 2)
            corner = low + self.rng.uniform(0, 0.86 - size)
            self.rectangle(corner, size, np.clip(rgb * self.rng.uniform(0.5, 1.4), 0, 1), 0.0)

    def labels(self) -> None:
        """The numbers 1 to 16 in segments."""
        for number, (row, column) in enumerate(np.ndindex(CELLS, CELLS), 1):
            start = column + 0.5 - 0.2 * len(str(number))
            for place, digit in enumerate(str(number)):
                corner = (start + 0.4 * place + 0.05, row + 0.2)
                for name in _DIGITS[int(digit)]:
                    x, y, width, height = (0.3 * value for value in _SEGMENTS[name])
                    self.rectangle(np.add(corner, (x, y)), (width, height), (0.08, 0.08, 0.1), 0.0)


_COLOURS: tuple[Rgb, ...] = (
    (0.80, 0.16, 0.14),
    (0.93, 0.52, 0.10),
    (0.95, 0.82, 0.20),
    (0.42, 0.68, 0.22),
    (0.10, 0.46, 0.34),
    (0.16, 0.62, 0.72),
    (0.14, 0.30, 0.66),
    (0.46, 0.24, 0.58),
    (0.86, 0.46, 0.62),
    (0.92, 0.88, 0.78),
    (0.30, 0.22, 0.18),
    (0.12, 0.12, 0.14),
)
# Segments of a digit, each (x, y, width, height) in a cell 1 wide and 2 high.
_SEGMENTS = {
    "a": (0.0, 1.8, 1.0, 0.2),
    "b": (0.8, 1.0, 0.2, 1.0),
    "c": (0.8, 0.0, 0.2, 1.0),
    "d": (0.0, 0.0, 1.0, 0.2),
    "e": (0.0, 0.0, 0.2, 1.0),
    "f": (0.0, 1.0, 0.2, 1.0),
    "g": (0.0, 0.9, 1.0, 0.2),
}
_DIGITS = ("abcdef", "bc", "abged", "abgcd", "fgbc", "afgcd", "afgcde", "abc", "abcdefg", "abcfgd")
