# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Facades: four floors of windows on brick, plaster, stone or panels."""

from dataclasses import dataclass

import numpy as np

from fusionslam.sim.canvas import Canvas, noise
from fusionslam.sim.mesh import Rgb

FLOOR_M = 3.0
_EXTENT = (12.0, 4 * FLOOR_M)


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
        return _EXTENT[0] / self.bays


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


def paint_facade(style: FacadeStyle, rng: np.random.Generator) -> Canvas:
    """Paint four floors (3 m each) and 12 m of one style of wall."""
    canvas = _wall(style.material, rng)
    canvas.shade(0.10 * noise(rng, 0.8))
    for floor in range(4):
        canvas.rectangle((0, floor * FLOOR_M), (12, 0.12), (0.72, 0.71, 0.69), 0.4)
        for bay in range(style.bays):
            _window(canvas, style, rng, (bay + 0.5) * style.bay_m, floor * FLOOR_M)
    canvas.shade(0.05 * noise(rng, 0.4))
    return canvas


def _wall(material: str, rng: np.random.Generator) -> Canvas:
    canvas = Canvas(_EXTENT, (0.80, 0.80, 0.80), 1.0)
    grey = (0.62, 0.61, 0.60)
    if material == "brick":
        canvas.bricks(rng, brick=(0.3, 0.12), joint=0.025, joint_rgb=grey, spread=0.22)
    elif material == "stone":
        canvas.bricks(rng, brick=(0.75, 0.375), joint=0.04, joint_rgb=grey, spread=0.16)
    elif material == "panel":
        canvas.bricks(rng, brick=(3.0, 3.0), joint=0.06, joint_rgb=(0.4, 0.4, 0.4), spread=0.06)
    return canvas


def _window(
    canvas: Canvas, style: FacadeStyle, rng: np.random.Generator, centre: float, floor_y: float
) -> None:
    width, height = style.window
    left, bottom = centre - width / 2, floor_y + 0.95
    canvas.rectangle((left - 0.1, bottom - 0.1), (width + 0.2, height + 0.2), style.frame, 0.0)
    _glass(canvas, rng, (left, bottom), (width, height))
    canvas.rectangle((centre - 0.03, bottom), (0.06, height), style.frame, 0.0)
    if width < 1.6:
        canvas.rectangle((left, bottom + 0.65 * height), (width, 0.06), style.frame, 0.0)
    if style.shutters:
        for x in (left - 0.55, left + width + 0.1):
            canvas.rectangle((x, bottom - 0.05), (0.45, height + 0.1), (0.42, 0.47, 0.42), 0.5)
    if style.balconies and rng.random() < 0.6:
        canvas.rectangle((left - 0.2, floor_y), (width + 0.4, 0.95), (0.55, 0.55, 0.58), 0.3)
    else:
        canvas.rectangle((left - 0.15, bottom - 0.2), (width + 0.3, 0.1), (0.7, 0.69, 0.67), 0.0)


def _glass(
    canvas: Canvas,
    rng: np.random.Generator,
    corner: tuple[float, float],
    size: tuple[float, float],
) -> None:
    """Paint dark panes that reflect the sky towards the top, some with curtains or a blind."""
    dark = rng.uniform(0.10, 0.24)
    for step in range(4):
        level = dark + 0.05 * step
        rgb = (0.85 * level, 0.95 * level, 1.1 * level)
        y = corner[1] + step * size[1] / 4
        canvas.rectangle((corner[0], y), (size[0], size[1] / 4), rgb, 0.0)
    cloth = rng.uniform(0.5, 0.85) * np.array((1.0, 0.97, 0.9))
    kind = rng.random()
    if kind < 0.3:
        for x in (corner[0], corner[0] + 0.75 * size[0]):
            canvas.rectangle((x, corner[1]), (0.25 * size[0], size[1]), cloth, 0.0)
    elif kind < 0.5:
        part = rng.uniform(0.25, 0.8) * size[1]
        canvas.rectangle((corner[0], corner[1] + size[1] - part), (size[0], part), cloth, 0.0)
