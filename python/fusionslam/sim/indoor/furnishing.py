# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Furnish a room step by step, as ``furnishing.yaml`` says for its kind."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fusionslam.sim.canvas import follow, read_table
from fusionslam.sim.indoor.furniture import (
    CLOTHS,
    PALETTE,
    Style,
    bookcase,
    carpet,
    counter,
    group,
    make_piece,
    picture,
    plant,
    toys,
)
from fusionslam.sim.indoor.layout import Layout
from fusionslam.sim.indoor.objects import Thing
from fusionslam.sim.indoor.textures import Look
from fusionslam.sim.mesh import Rgb


class Furnisher:
    """Puts furniture of one style into one room. Where there are several kinds, one is drawn.

    Args:
        layout: of the room.
        style: its colours.
        clutter: share of the small objects that are present.
        rng: decides everything else.
    """

    def __init__(
        self, layout: Layout, style: Style, clutter: float, rng: np.random.Generator
    ) -> None:
        self._layout, self._style, self._clutter, self._rng = layout, style, clutter, rng

    def also(self, name: str) -> None:
        """Follow the steps of a kind of room."""
        follow(self, read_table(Path(__file__).with_suffix(".yaml"))[name])

    def stand(self, *kinds: str, tint: Sequence[str] = ("WHITE",)) -> None:
        """Stand a piece at a wall."""
        self._layout.along_wall(self._piece(kinds, tint))

    def maybe(self, *kinds: str, tint: Sequence[str] = ("WHITE",), least: float = 0.0) -> None:
        """Stand a piece at a wall with the probability of the clutter, or ``least`` if greater."""
        if self._rng.random() < max(self._clutter, least):
            self.stand(*kinds, tint=tint)

    def anywhere(self, *kinds: str) -> None:
        """Stand a piece at a random place."""
        self._layout.anywhere(self._piece(kinds, ("WHITE",)))

    def bookcase(self, width: float, *heights: float) -> None:
        """Stand a bookcase at a wall."""
        height = heights[self._rng.integers(len(heights))]
        self._layout.along_wall(bookcase(self._rng, self._style, width, height))

    def counter(self, units: int, *, oven: bool = False) -> None:
        """Stand a kitchen counter at a wall, one of its units an oven."""
        place = int(self._rng.integers(units)) if oven else None
        self._layout.along_wall(counter(self._style, units, place))

    def bed(self) -> None:
        """Stand a double bed at a wall; if there is no room for it, or by chance, a single one."""
        wide = make_piece("bed.double", self._style)
        if not (self._rng.random() < 0.7 and self._layout.along_wall(wide)):
            self.stand("bed.single")

    def workplace(self) -> None:
        """Stand a desk with its chair at a wall."""
        desk, chair = make_piece("desk", self._style), make_piece("chair", self._style)
        placed = [(desk, (0.0, 0.1, 0.0), 0.0), (chair, (-0.2, -0.3, 0.0), np.pi)]
        self._layout.along_wall(group("workplace", placed))

    def dining_set(self) -> None:
        """Put a table with chairs into the room if they fit, else a small table at a wall."""
        if self._rng.random() < 0.5:
            spots = [(x, y) for y in (-0.5, 0.5) for x in (-0.35, 0.35)]
            base = make_piece("table.dining", self._style)
        else:
            spots = [(0.0, -0.55), (0.0, 0.55)]
            base = make_piece("round_table", self._style)
        chair = make_piece("chair", self._style)
        chairs = [(chair, (x, y, 0.0), np.pi if y < 0 else 2 * np.pi) for x, y in spots]
        whole = group("dining_set", [(base, (0.0, 0.0, 0.0), 0.0), *chairs])
        if not (self._layout.anywhere(whole) or self._layout.along_wall(whole)):
            self.stand("table.small")

    def carpet(
        self, width: float, depth: float, tint: Sequence[str] = ("accent",), look: str = "rug"
    ) -> None:
        """Lay a carpet in the middle."""
        self._layout.lay(carpet(self._tint(tint), width, depth, Look[look.upper()]))

    def lift(self) -> None:
        """Put the doors of a lift into a wall."""
        self._layout.on_wall(make_piece("lift", tint=self._style.cloth), 0.0)

    def picture(self, width: float, height: float, z: float) -> None:
        """Hang one picture, its lower edge at ``z``."""
        number = int(self._rng.integers(16))
        self._layout.on_wall(picture(number, width, height), z)

    def pictures(self, count: int, size: Sequence[float] | None = None, z: float = 1.15) -> None:
        """Hang different pictures, of random size if there is none."""
        for number in self._rng.permutation(16)[:count]:
            width, height = size or self._rng.uniform(0.4, 0.8, 2)
            self._layout.on_wall(picture(int(number), width, height), z)

    def _piece(self, kinds: Sequence[str], tint: Sequence[str]) -> Thing:
        kind = str(self._rng.choice(kinds))
        drawn = {"plant": plant, "toys": toys}.get(kind)
        return drawn(self._rng) if drawn else make_piece(kind, self._style, self._tint(tint))

    def _tint(self, names: Sequence[str]) -> Rgb:
        """One of the colours of these names: of the palette, of the style, or any cloth's."""
        name = str(self._rng.choice(names))
        if name == "CLOTHS":
            return CLOTHS[self._rng.integers(len(CLOTHS))]
        tint: Rgb = {**PALETTE, **vars(self._style)}[name]
        return tint
