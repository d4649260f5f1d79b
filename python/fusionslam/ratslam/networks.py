# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""How odometry and views move activity on the sheet: as the reference does it, and steadily."""

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import PoseSheet
from fusionslam.errors import DataError
from fusionslam.ratslam.places import (
    HEADINGS,
    LAYER,
    NOWHERE,
    Place,
    after,
    arc,
    back,
    differences,
    on_sheet,
)

Floats = NDArray[np.float64]

# Sines of the layers out of those of a quarter: opposite ones are equal to the last bit, so that a
# symmetric packet stays symmetric.
_QUARTER = np.sin(np.arange(HEADINGS // 4 + 1) * LAYER)
_HALF = np.concatenate((_QUARTER, _QUARTER[-2:0:-1]))
_SINES = np.concatenate((_HALF, -_HALF))
_COSINES = np.roll(_SINES, -HEADINGS // 4)
# A packet that is decoded farther from where it was than this has given way to another one.
_JUMP = 1.0
# Steps of the attractor after which nothing changes any more: longer gaps take no further ones.
_SETTLED = 100


class Network(Protocol):
    """A sheet of pose cells with what drives it."""

    @property
    def best(self) -> Place:
        """The decoded pose."""

    @property
    def activity(self) -> Floats:
        """float64 (36, n, n) by th, y, x: a copy."""

    def move(self, way: float, turn: float, dt: float) -> None:
        """Odometry: cells forwards, radians, seconds, all finite."""

    def inject(self, place: Place, energy: float) -> None:
        """A view says that the robot is at this place."""

    def accept(self) -> None:
        """The place to which the packet jumped is right."""

    def go_back(self) -> None:
        """It is wrong: be where odometry alone leads to from before the jump."""

    def numbers(self) -> Floats:
        """What it remembers besides the cells, float64 (k,)."""

    def remember(self, cells: Floats, numbers: Floats) -> None:
        """Take over ``activity`` as it is stored and ``numbers``; raises DataError."""

    @property
    def cells(self) -> Floats:
        """What ``remember`` takes: the cells as they are stored."""


class ReferenceNetwork:
    """A step of the attractor with each odometry, as in the reference run (Ball et al. 2013).

    Args:
        size: cells along x and y.
        global_inhibition: taken from every cell in each step.
    """

    def __init__(self, size: int, global_inhibition: float) -> None:
        self._sheet, self._inhibition = PoseSheet(size), global_inhibition
        self._best = Place(float(size // 2), float(size // 2), float(HEADINGS // 2))

    @property
    def best(self) -> Place:
        return self._best

    @property
    def activity(self) -> Floats:
        return self._sheet.activity

    cells = activity

    def move(self, way: float, turn: float, dt: float) -> None:
        """Here heading 0 moves the packet along +y. Raises DataError for steps of a cell or more."""
        if abs(way) >= 1:
            raise DataError(
                f"odometry: a step of {abs(way):.6g} cells, the openratslam preset takes less than "
                "one; give shorter steps, larger cells, or preset='robust'"
            )
        self._sheet.settle(self._inhibition)
        self._sheet.move(way * _SINES, way * _COSINES, turn / LAYER)
        self._best = Place(*self._sheet.decode())

    def inject(self, place: Place, energy: float) -> None:
        """Into one cell, the one whose corner lies before the place."""
        x, y, th = (float(math.floor(value)) for value in place)
        self._sheet.inject(x, y, th, energy)

    def accept(self) -> None:
        """The reference knows no doubt."""

    def go_back(self) -> None:
        """The reference knows no doubt."""

    def numbers(self) -> Floats:
        return np.array(self._best)

    def remember(self, cells: Floats, numbers: Floats) -> None:
        if numbers.shape != (3,):
            raise DataError(f"network: {numbers.shape[0]} numbers, expected 3")
        self._sheet.assign(cells)
        self._best = Place(*numbers.tolist())


class SteadyNetwork:
    """A step of the attractor every ``step_s`` seconds of odometry; between them exact motion.

    The attractor pulls a packet towards the middle of cells, which makes it up to a fifth slower
    than the robot, the slower the smaller the steps. Here it only decides which packet wins: after
    each step the winner is put back to where odometry and views have it. So neither how often
    odometry nor how often views arrive changes the pose. Heading 0 moves the packet along +x.

    Args:
        size: cells along x and y.
        global_inhibition: taken from every cell in each step.
        step_s: seconds.
    """

    def __init__(self, size: int, global_inhibition: float, step_s: float) -> None:
        self._sheet, self._size = PoseSheet(size), size
        self._inhibition, self._step_s = global_inhibition, step_s
        # Where the packet belongs, and what it is off; then the way since the last step.
        self._base = Place(float(size // 2), float(size // 2), float(HEADINGS // 2))
        self._slip, self._way, self._seconds = NOWHERE, NOWHERE, 0.0
        self._before: Place | None = None

    @property
    def best(self) -> Place:
        return on_sheet(after(self._base, self._way), self._size)

    @property
    def activity(self) -> Floats:
        moved = PoseSheet(self._size)
        moved.assign(self._sheet.activity)
        self._follow(moved)
        return moved.activity

    @property
    def cells(self) -> Floats:
        return self._sheet.activity

    def _follow(self, sheet: PoseSheet) -> None:
        """Every layer goes the way that the robot went, in its own direction."""
        way, slip = self._way, self._slip
        sheet.move(
            _COSINES * way.x - _SINES * way.y + slip.x,
            _SINES * way.x + _COSINES * way.y + slip.y,
            way.th + slip.th,
        )

    def move(self, way: float, turn: float, dt: float) -> None:
        """Steps fall on the same stamps however odometry is cut."""
        if dt <= 0:
            return
        skipped = (self._seconds + dt) // self._step_s - _SETTLED
        left = dt
        if skipped > 0:
            self._go(way, turn, skipped * self._step_s / dt)
            left -= skipped * self._step_s
        while self._seconds + left >= self._step_s * (1 - 1e-9):
            part = max(self._step_s - self._seconds, 0.0)
            self._go(way, turn, part / dt)
            self._step()
            left -= part
        left = max(left, 0.0)
        self._go(way, turn, left / dt)
        self._seconds += left

    def _go(self, way: float, turn: float, part: float) -> None:
        piece = arc(way * part, turn * part)
        self._way = after(self._way, piece)
        if self._before is not None:
            self._before = on_sheet(after(self._before, piece), self._size)

    def _step(self) -> None:
        self._sheet.settle(self._inhibition)
        self._follow(self._sheet)
        here = self.best
        self._way, self._seconds = NOWHERE, 0.0
        self._place_packet(here, Place(*self._sheet.decode()))

    def _place_packet(self, expected: Place, found: Place) -> None:
        """What was decoded is a packet off its place, or another packet."""
        slip = Place(*differences(expected, found, self._size).tolist())
        if max(map(abs, slip)) < _JUMP:
            self._base, self._slip = expected, slip
        else:
            self._before = self._before or on_sheet(after(expected, self._way), self._size)
            self._base, self._slip = found, NOWHERE

    def inject(self, place: Place, energy: float) -> None:
        """Spread over the cells around the place; the packet moves as far as its mean does."""
        before = Place(*self._sheet.decode())
        place = after(place, back(self._way))
        x, y, th = (one - slip for one, slip in zip(place, self._slip, strict=True))
        self._sheet.inject(x, y, th, energy)
        self._sheet.assign(self._sheet.activity / (1 + energy))
        found = Place(*self._sheet.decode())
        moved = differences(found, before, self._size)
        if np.abs(moved).max() < _JUMP:
            base = Place(*(np.array(self._base) + moved).tolist())
            self._base = on_sheet(base, self._size)
        else:
            self._place_packet(self._base, found)

    def accept(self) -> None:
        self._before = None

    def go_back(self) -> None:
        if self._before is None:
            return
        cells = np.zeros((HEADINGS, self._size, self._size))
        cells[0, 0, 0] = np.finfo(np.float64).tiny
        self._sheet.assign(cells)
        self._sheet.inject(*self._before, 1.0)
        self._base, self._slip, self._way = self._before, NOWHERE, NOWHERE
        self._before = None

    def numbers(self) -> Floats:
        before = (math.nan,) * 3 if self._before is None else self._before
        return np.array([*self._base, *self._slip, *self._way, self._seconds, *before])

    def remember(self, cells: Floats, numbers: Floats) -> None:
        if numbers.shape != (13,) or not np.isfinite(numbers[:10]).all():
            raise DataError("network: expected 13 numbers, the first ten of them finite")
        self._sheet.assign(cells)
        values = numbers.tolist()
        self._base, self._slip, self._way = (Place(*values[i : i + 3]) for i in (0, 3, 6))
        self._seconds = values[9]
        self._before = None if math.isnan(values[10]) else Place(*values[10:])
