# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The town's textures: walls, streets, leaves and cars, with the contrast that stereo needs."""

from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from fusionslam.base.arrays import Image
from fusionslam.sim.canvas import Canvas, follow, paint_textures, read_table
from fusionslam.sim.mesh import Rgb, Texture

FLOOR_M = 3.0


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


@dataclass(frozen=True)
class FacadeStyle:
    """A kind of wall: material, number of bays in 12 m, window size in metres, extras."""

    material: str
    bays: int
    window: tuple[float, float]
    frame: Rgb = (0.88, 0.88, 0.86)
    shutters: bool = False
    balconies: bool = False

    @property
    def bay_m(self) -> float:
        """Width of one bay; a wall whose length is a multiple of it cuts through no window."""
        return Look.FACADE.extent[0] / self.bays


FACADES: tuple[FacadeStyle, ...] = (
    FacadeStyle("brick", 4, (1.1, 1.5)),
    FacadeStyle("brick", 3, (1.9, 1.4), frame=(0.25, 0.22, 0.20)),
    FacadeStyle("plaster", 4, (1.0, 1.4), shutters=True),
    FacadeStyle("plaster", 3, (2.2, 1.3)),
    FacadeStyle("plaster", 6, (0.8, 1.6), frame=(0.30, 0.30, 0.32)),
    FacadeStyle("stone", 4, (1.1, 1.8)),
    FacadeStyle("stone", 3, (1.5, 1.7), shutters=True),
    FacadeStyle("panel", 3, (2.4, 1.5), balconies=True),
    FacadeStyle("panel", 4, (2.0, 1.4)),
)


@lru_cache(maxsize=4)
def town_textures(seed: int) -> tuple[Image, ...]:
    """The images indexed by ``Look``, then the facades: uint8 (512, 512, 4) each, from a seed."""
    steps = read_table(Path(__file__).with_suffix(".yaml"))

    def paint(look: Look, name: str, style: FacadeStyle | None, rng: np.random.Generator) -> Canvas:
        canvas = TownCanvas(look.extent, rng)
        follow(canvas, steps[name])
        if style is not None:
            canvas.windows(style)
        return canvas

    plain = [partial(paint, look, look.name.lower(), None) for look in Look if look != Look.FACADE]
    facades = [partial(paint, Look.FACADE, f"facade_{kind.material}", kind) for kind in FACADES]
    return paint_textures(seed, 0x7E87, [*plain, *facades])


class TownCanvas(Canvas):
    """A canvas for streets and facades."""

    def redden(self, contrast: float, roughness: float) -> None:
        """Noise in red alone."""
        self.rgb[..., 0] *= 1 + contrast * self.noise(roughness)

    def asphalt(self, patches: int) -> None:
        """Grey asphalt with repairs, stains and manholes."""
        self.fill((0.40, 0.40, 0.41), 1.0)
        for _ in range(patches):
            corner = self.rng.uniform((0, 0), self.extent)
            size = self.rng.uniform((0.3, 0.4), (1.8, 4.0))
            self.rectangle(corner, size, (self.rng.uniform(0.28, 0.52),) * 3, 1.0)
        for _ in range(3):
            corner = self.rng.uniform((0, 0), self.extent)
            self.rectangle(corner, (0.6, 0.6), (0.22, 0.21, 0.20), 0.0)
        self.shade(0.17, 0.55)

    def windows(self, style: FacadeStyle) -> None:
        """Four floors of windows on a wall."""
        self.shade(0.10, 0.8)
        for floor in range(4):
            self.rectangle((0, floor * FLOOR_M), (12, 0.12), (0.72, 0.71, 0.69), 0.4)
            for bay in range(style.bays):
                self._window(style, (bay + 0.5) * style.bay_m, floor * FLOOR_M)
        self.shade(0.05, 0.4)

    def _window(self, style: FacadeStyle, centre: float, floor_y: float) -> None:
        width, height = style.window
        left, bottom = centre - width / 2, floor_y + 0.95
        self.rectangle((left - 0.1, bottom - 0.1), (width + 0.2, height + 0.2), style.frame, 0.0)
        self._glass((left, bottom), (width, height))
        self.rectangle((centre - 0.03, bottom), (0.06, height), style.frame, 0.0)
        if width < 1.6:
            self.rectangle((left, bottom + 0.65 * height), (width, 0.06), style.frame, 0.0)
        if style.shutters:
            for x in (left - 0.55, left + width + 0.1):
                self.rectangle((x, bottom - 0.05), (0.45, height + 0.1), (0.42, 0.47, 0.42), 0.5)
        if style.balconies and self.rng.random() < 0.6:
            self.rectangle((left - 0.2, floor_y), (width + 0.4, 0.95), (0.55, 0.55, 0.58), 0.3)
        else:
            self.rectangle((left - 0.15, bottom - 0.2), (width + 0.3, 0.1), (0.7, 0.69, 0.67), 0.0)

    def _glass(self, corner: tuple[float, float], size: tuple[float, float]) -> None:
        """Paint dark panes that reflect the sky towards the top, some with curtains or a blind."""
        dark = self.rng.uniform(0.10, 0.24)
        for step in range(4):
            level = dark + 0.05 * step
            rgb = (0.85 * level, 0.95 * level, 1.1 * level)
            y = corner[1] + step * size[1] / 4
            self.rectangle((corner[0], y), (size[0], size[1] / 4), rgb, 0.0)
        cloth = self.rng.uniform(0.5, 0.85) * np.array((1.0, 0.97, 0.9))
        kind = self.rng.random()
        if kind < 0.3:
            for x in (corner[0], corner[0] + 0.75 * size[0]):
                self.rectangle((x, corner[1]), (0.25 * size[0], size[1]), cloth, 0.0)
        elif kind < 0.5:
            part = self.rng.uniform(0.25, 0.8) * size[1]
            self.rectangle((corner[0], corner[1] + size[1] - part), (size[0], part), cloth, 0.0)
