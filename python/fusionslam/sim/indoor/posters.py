# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Sheets of small prints: pictures for walls, and numbers for doors, bays and shelves."""

import numpy as np
from numpy.typing import NDArray

from fusionslam.sim.canvas import Canvas, noise
from fusionslam.sim.mesh import Rgb

# A sheet holds CELLS x CELLS prints, numbered from the lower left one, row by row.
CELLS = 4

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


def pictures(rng: np.random.Generator) -> Canvas:
    """Sixteen framed pictures: landscapes, discs and stripes, no two of the same colours."""
    canvas = Canvas((CELLS, CELLS), (0.16, 0.12, 0.09), 1.0)
    order = rng.permutation(len(_COLOURS))
    makers = (_landscape, _discs, _blocks)
    for number, (row, column) in enumerate(np.ndindex(CELLS, CELLS)):
        low = np.array((column + 0.07, row + 0.07))
        first, second = (_COLOURS[order[(number + k) % len(order)]] for k in (0, 1 + number // 12))
        canvas.rectangle(low, (0.86, 0.86), first, 0.0)
        makers[number % 3](canvas, rng, low, np.asarray(second))
    canvas.shade(0.05 * noise(rng, 0.6))
    return canvas


def labels() -> Canvas:
    """Sixteen plates with the numbers 1 to 16 on a background that takes the tint."""
    canvas = Canvas((CELLS, CELLS), (0.95, 0.95, 0.95), 1.0)
    for number, (row, column) in enumerate(np.ndindex(CELLS, CELLS), 1):
        canvas.rectangle((column, row), (1.0, 0.05), (0.1, 0.1, 0.1), 0.0)
        digits = str(number)
        start = column + 0.5 - 0.2 * len(digits)
        for place, digit in enumerate(digits):
            _digit(canvas, int(digit), (start + 0.4 * place + 0.05, row + 0.2))
    return canvas


def _digit(canvas: Canvas, digit: int, corner: tuple[float, float]) -> None:
    for name in _DIGITS[digit]:
        x, y, width, height = (0.3 * value for value in _SEGMENTS[name])
        canvas.rectangle((corner[0] + x, corner[1] + y), (width, height), (0.08, 0.08, 0.1), 0.0)


Place = NDArray[np.float64]


def _landscape(canvas: Canvas, rng: np.random.Generator, low: Place, rgb: Place) -> None:
    skyline = 0.25 + 0.15 * rng.random() + 0.1 * np.cumsum(rng.uniform(-0.5, 0.5, 20))
    for k, height in enumerate(np.clip(skyline, 0.1, 0.6)):
        canvas.rectangle(np.add(low, (0.043 * k, 0)), (0.043, height), rgb, 0.0)
    canvas.disc(np.add(low, (rng.uniform(0.2, 0.7), 0.7)), 0.09, (0.97, 0.93, 0.75), 0.0)


def _discs(canvas: Canvas, rng: np.random.Generator, low: Place, rgb: Place) -> None:
    for radius, factor in ((0.36, 1.0), (0.26, 0.6), (0.15, 1.3)):
        middle = low + 0.43 + rng.uniform(-0.05, 0.05, 2)
        canvas.disc(middle, radius, np.clip(rgb * factor, 0, 1), 0.0)


def _blocks(canvas: Canvas, rng: np.random.Generator, low: Place, rgb: Place) -> None:
    for _ in range(6):
        size = rng.uniform(0.1, 0.45, 2)
        corner = low + rng.uniform(0, 0.86 - size)
        canvas.rectangle(corner, size, np.clip(rgb * rng.uniform(0.5, 1.4), 0, 1), 0.0)
