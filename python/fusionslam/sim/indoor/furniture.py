# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Furniture from the table in ``furniture.yaml``, and the colours that furniture comes in."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fusionslam.sim.indoor.objects import Thing, block, cylinder, front, legs, thing, wheel
from fusionslam.sim.indoor.textures import BLUE, DARK, GREY, STEEL, TIMBER, WHITE, Look
from fusionslam.sim.mesh import Mesh, Paint, Rgb, box, tapered_box, tube

WOODS: tuple[Rgb, ...] = (
    (0.86, 0.66, 0.42),
    (0.62, 0.40, 0.24),
    (0.42, 0.26, 0.17),
    (0.95, 0.86, 0.70),
    (0.98, 0.97, 0.94),
    (0.36, 0.36, 0.38),
)
CLOTHS: tuple[Rgb, ...] = (
    (0.78, 0.18, 0.16),
    (0.16, 0.30, 0.62),
    (0.18, 0.50, 0.30),
    (0.92, 0.68, 0.16),
    (0.52, 0.26, 0.56),
    (0.16, 0.58, 0.60),
    (0.90, 0.46, 0.16),
    (0.88, 0.48, 0.60),
    (0.46, 0.46, 0.48),
    (0.60, 0.44, 0.30),
)
_PALETTE: Mapping[str, Rgb] = {
    "BLUE": BLUE,
    "DARK": DARK,
    "GREY": GREY,
    "STEEL": STEEL,
    "TIMBER": TIMBER,
    "WHITE": WHITE,
}
_SHAPES: Mapping[str, Callable[..., Mesh]] = {
    "box": box,
    "block": block,
    "tapered_box": tapered_box,
    "tube": tube,
    "cylinder": cylinder,
    "wheel": wheel,
    "legs": legs,
    "front": front,
}


@dataclass(frozen=True)
class Style:
    """Colours that the furniture of one room shares: wood, cloth and small things."""

    wood: Rgb
    cloth: Rgb
    accent: Rgb

    @staticmethod
    def draw(rng: np.random.Generator) -> "Style":
        """Draw a random style: a wood and two different cloths."""
        cloth, accent = rng.choice(len(CLOTHS), 2, replace=False)
        return Style(WOODS[rng.integers(len(WOODS))], CLOTHS[cloth], CLOTHS[accent])


@lru_cache(maxsize=256)
def make_piece(kind: str, style: Style | None = None, tint: Rgb = WHITE) -> Thing:
    """A piece of furniture of the table, in the colours of a style or with one of its own."""
    colors = {**_PALETTE, "tint": tint, **(vars(style) if style else {})}
    visual, solid = [], []
    for row in _read_table()[kind]:
        meshes = list(_make_shape(row, colors))
        if row.get("seen", True):
            visual += meshes
        if row.get("hit", True):
            solid += meshes
    return thing(kind, visual, solid)


@cache
def _read_table() -> Mapping[str, Any]:
    text = Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
    table: Mapping[str, Any] = yaml.safe_load(text)
    return table


def _make_shape(row: Mapping[str, Any], colors: Mapping[str, Rgb]) -> Iterator[Mesh]:
    """The shape of one row of the table, and its copies."""
    tint, look = row.get("tint", (1.0, 1.0, 1.0)), Look[row.get("texture", "plain").upper()]
    rgb = colors[tint] if isinstance(tint, str) else tuple(tint)
    cover = Paint(look, rgb, tuple(row.get("fit", look.extent)))
    options = {key: row[key] for key in ("sides", "along") if key in row}
    shape = next(name for name in _SHAPES if name in row)
    for values in _copies(shape, row[shape], row):
        yield _SHAPES[shape](*values, cover, **options)


def _copies(shape: str, values: list[Any], row: Mapping[str, Any]) -> Iterator[list[Any]]:
    """The arguments of a shape, mirrored or turned as its row says."""
    if "around" in row:
        (radius, _, z), *rest = values
        for angle in np.arange(row["around"]) * 2 * np.pi / row["around"]:
            yield [(radius * np.cos(angle), radius * np.sin(angle), z), *rest]
        return
    signs = [(1, -1) if axis in row.get("mirror", "") else (1,) for axis in "xy"]
    for x, y in product(*signs):
        if shape == "wheel":
            yield [x * values[0], y * values[1], *values[2:]]
        elif shape == "tube":
            yield [*(np.array(values[:2]) * (x, y, 1)), *values[2:]]
        elif "mirror" in row:
            corners = np.array(values[:2]) * (x, y, 1)
            yield [corners.min(axis=0), corners.max(axis=0), *values[2:]]
        else:
            yield values
