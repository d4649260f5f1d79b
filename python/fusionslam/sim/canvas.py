# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Procedural textures, painted on a square image with coordinates in metres.

A texture is uint8 (SIDE, SIDE, 4): RGB and how strongly the surface's tint colours that texel (255:
fully; so one brick wall serves red and yellow houses while its windows stay the same). All
textures repeat seamlessly.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from fusionslam.base.arrays import Image

SIDE = 512
_HERE = (0.0,)


class Canvas:
    """SIDE x SIDE texels that cover ``extent`` metres; x to the right, y upwards, both repeat.

    It starts black, without tint. A list of steps in a YAML file, such as
    ``{rectangle: [[0, 0], [1, 2], [0.4, 0.4, 0.4], 1.0], x: [0, 3]}``, calls its methods by name.

    Attributes:
        rgb: float32 (SIDE, SIDE, 3), 0 .. 1, row 0 on top.
        tint: float32 (SIDE, SIDE), 0 .. 1, how strongly the surface's tint colours the texel.
    """

    def __init__(self, extent: tuple[float, float], rng: np.random.Generator) -> None:
        self.extent = extent
        self.scale = SIDE / np.asarray(extent)
        self.rng = rng
        self.rgb = np.zeros((SIDE, SIDE, 3), np.float32)
        self.tint = np.zeros((SIDE, SIDE), np.float32)

    def fill(self, rgb: ArrayLike, tint: float) -> None:
        """Fill all of it with one colour."""
        self.rgb[:], self.tint[:] = rgb, tint

    def rough(self, rgb: ArrayLike, contrast: float, roughness: float = 0.7) -> None:
        """Fill all of it with one colour that takes the tint, and with noise at every scale."""
        self.fill(rgb, 1.0)
        self.shade(contrast, roughness)

    def rectangle(
        self,
        corner: ArrayLike,
        size: ArrayLike,
        rgb: ArrayLike,
        tint: float,
        x: Sequence[float] = _HERE,
        y: Sequence[float] = _HERE,
    ) -> None:
        """Fill a rectangle given by its lower left corner and its size in metres.

        With ``x`` and ``y``, also its copies shifted by each pair of these, metres.
        """
        for shift in product(x, y):
            start = np.asarray(corner) + shift
            low = np.round(start * self.scale).astype(int)
            high = np.round((start + np.asarray(size)) * self.scale).astype(int)
            high = np.maximum(high, low + 1)
            columns = np.arange(low[0], high[0]) % SIDE
            rows = (SIDE - 1 - np.arange(low[1], high[1])) % SIDE
            area = np.ix_(rows, columns)
            self.rgb[area] = np.asarray(rgb, np.float32)
            self.tint[area] = tint

    def disc(
        self,
        centre: ArrayLike,
        radius: float,
        rgb: ArrayLike,
        tint: float,
        x: Sequence[float] = _HERE,
    ) -> None:
        """Fill a disc, clipped at the edges; centre, radius and shifts of copies in metres."""
        texels = np.arange(SIDE) + 0.5
        for shift in x:
            across = texels / self.scale[0] - (np.asarray(centre)[0] + shift)
            upward = (SIDE - texels) / self.scale[1] - np.asarray(centre)[1]
            near = np.ix_(*(np.flatnonzero(np.abs(v) < radius) for v in (upward, across)))
            inside = across[near[1]] ** 2 + upward[near[0]] ** 2 < radius**2
            color = np.asarray(rgb, np.float32)
            self.rgb[near] = np.where(inside[..., None], color, self.rgb[near])
            self.tint[near] = np.where(inside, np.float32(tint), self.tint[near])

    def bricks(
        self, brick: tuple[float, float], joint: float, joint_rgb: ArrayLike, spread: float
    ) -> None:
        """Paint courses of bricks (width, height in metres), every other one shifted by half."""
        columns, rows = np.maximum(np.round(SIDE / self.scale / brick).astype(int), 1)
        across = np.linspace(0, columns, SIDE, endpoint=False)
        upward = np.linspace(0, rows, SIDE, endpoint=False)[::-1, None]
        row = upward.astype(int)
        shifted = (across[None, :] + 0.5 * (row % 2)) % columns
        shades = 1 + spread * self.rng.uniform(-1, 1, (rows, columns))
        self.rgb *= shades[row, shifted.astype(int)][..., None].astype(np.float32)
        in_joint = (shifted % 1 < joint / brick[0]) | (upward % 1 < joint / brick[1])
        self.rgb[in_joint] = joint_rgb

    def shade(self, contrast: float, roughness: float) -> None:
        """Brighten and darken with noise."""
        self.brighten(contrast * self.noise(roughness))

    def brighten(self, change: NDArray[np.float32]) -> None:
        """Brighten every texel by a factor of 1 + change, (SIDE, SIDE)."""
        self.rgb *= 1 + change[..., None]

    def noise(self, roughness: float) -> NDArray[np.float32]:
        """Periodic noise, float32 (SIDE, SIDE), mean 0, deviation 1, clipped to -3 .. 3.

        Its amplitude falls with frequency to the power ``roughness``: 0 is white, 1 is cloudy.
        """
        spectrum = np.fft.rfft2(self.rng.standard_normal((SIDE, SIDE)))
        frequency = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.fft.rfftfreq(SIDE)[None, :])
        frequency[0, 0] = np.inf
        smooth = np.fft.irfft2(spectrum / frequency**roughness, s=(SIDE, SIDE))
        scaled: NDArray[np.float32] = np.clip(smooth / smooth.std(), -3, 3).astype(np.float32)
        return scaled

    def image(self) -> Image:
        """uint8 (SIDE, SIDE, 4): RGB and tint."""
        stacked = np.dstack([self.rgb, self.tint])
        image: Image = np.clip(stacked * 255 + 0.5, 0, 255).astype(np.uint8)
        return image


def follow(actor: object, steps: Iterable[Mapping[str, Any]]) -> None:
    """Call the methods that steps name, in order, with their arguments and options."""
    for step in steps:
        (name, arguments), *options = step.items()
        getattr(actor, name)(*arguments, **dict(options))


@cache
def read_table(file: Path) -> Mapping[str, Any]:
    """A YAML file of the package: the steps of each texture or room, or the shapes of a thing."""
    table: Mapping[str, Any] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return table


def paint_textures(
    seed: int, salt: int, painters: Iterable[Callable[[np.random.Generator], Canvas]]
) -> tuple[Image, ...]:
    """Paint one texture for each painter, with random numbers of its own."""
    return tuple(
        paint(np.random.default_rng([seed, number, salt])).image()
        for number, paint in enumerate(painters)
    )
