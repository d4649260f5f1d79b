# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Attractor networks of pose cells: the reference's, and one independent of message rates.

Poses on the sheet of cells, and motions between them, are in cells.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from fusionslam._core import PoseSheet
from fusionslam.base.arrays import Floats
from fusionslam.errors import DataError, ShapeError

HEADINGS = 36
"""Layers of the sheet: headings ten degrees apart."""
LAYER = 2 * math.pi / HEADINGS
"""Angle between two layers, radians."""
# Sines of all layers, built from one quadrant: opposite ones agree to the last bit, so that a
# symmetric packet stays symmetric.
_QUARTER = np.sin(np.arange(HEADINGS // 4 + 1) * LAYER)
_HALF = np.concatenate((_QUARTER, _QUARTER[-2:0:-1]))
_SINES = np.concatenate((_HALF, -_HALF))
_COSINES = np.roll(_SINES, -HEADINGS // 4)
# If the decoded packet moved farther than this, in cells or layers, another packet has won.
_JUMP = 1.0
# Energy injected farther from the packet than this, in cells and layers, does not belong to it.
_REACH = 3
# After more attractor steps than this in one motion, only the packet is left.
_MOST = 100
# Steps until a packet that starts in eight cells has its final shape.
_FORMED = 10


class Place(NamedTuple):
    """A pose on the sheet in cells: x, y in [0, n), th in [0, 36), which is heading / 10 degrees.

    Also a motion: x forward, y to the left, th the turn, counter-clockwise, all of any size.
    """

    x: float
    y: float
    th: float


IDENTITY = Place(0.0, 0.0, 0.0)
"""The motion that changes nothing."""


def compose(place: Place, way: Place) -> Place:
    """Apply a motion to a place, without wrapping; or concatenate two motions."""
    cosine, sine = math.cos(place.th * LAYER), math.sin(place.th * LAYER)
    return Place(
        place.x + cosine * way.x - sine * way.y,
        place.y + sine * way.x + cosine * way.y,
        place.th + way.th,
    )


def inverse(way: Place) -> Place:
    """The inverse motion."""
    cosine, sine = math.cos(way.th * LAYER), math.sin(way.th * LAYER)
    return Place(-cosine * way.x - sine * way.y, sine * way.x - cosine * way.y, -way.th)


def motion_arc(way: float, turn: float) -> Place:
    """The motion along an arc: length in cells, turn in radians."""
    half = turn / 2
    chord = way * float(np.sinc(half / math.pi))
    return Place(chord * math.cos(half), chord * math.sin(half), turn / LAYER)


def wrap(place: Place, size: int) -> Place:
    """Wrap a place into [0, n) and [0, 36)."""
    return Place(
        _wrap_value(place.x, size), _wrap_value(place.y, size), _wrap_value(place.th, HEADINGS)
    )


def _wrap_value(value: float, period: int) -> float:
    rest = value % period
    return rest if rest < period else 0.0  # % rounds a tiny negative value up to the period


def differences(places: Any, other: Any, size: int) -> Floats:
    """The shortest differences on the wrapped sheet, float64 (..., 3), within half a period."""
    period = np.array((size, size, HEADINGS), np.float64)
    raw = np.asarray(places, np.float64) - np.asarray(other, np.float64)
    wrapped: Floats = (raw + period / 2) % period - period / 2
    return wrapped


class ReferenceNetwork:
    """One attractor step per odometry message, as in the reference run (Ball et al. 2013).

    It accepts every jump of the packet, so ``accept`` and ``go_back`` do nothing.

    Args:
        size: cells along x and y.
        global_inhibition: taken from every cell in each step.
    """

    def __init__(self, size: int, global_inhibition: float) -> None:
        self._sheet, self._inhibition = PoseSheet(size), global_inhibition
        self._best = Place(float(size // 2), float(size // 2), float(HEADINGS // 2))

    @property
    def best(self) -> Place:
        """The decoded pose."""
        return self._best

    @property
    def activity(self) -> Floats:
        """A copy of the activity, float64 (36, n, n) by th, y, x."""
        return self._sheet.activity

    cells = activity
    """The cells that ``restore`` takes."""

    def move(self, way: float, turn: float, dt: float) -> None:
        """Apply odometry: cells forward, radians, seconds; heading 0 is +y here.

        Raises:
            DataError: a step of a cell or more.
        """
        if abs(way) >= 1:
            raise DataError(
                f"odometry: a step of {abs(way):.6g} cells, the openratslam preset takes less than "
                "one; give shorter steps, larger cells, or preset='robust'"
            )
        self._sheet.settle(self._inhibition)
        self._sheet.move(way * _SINES, way * _COSINES, turn / LAYER)
        self._best = Place(*self._sheet.decode())

    def inject(self, place: Place, energy: float) -> None:
        """Add a view's energy to one cell: its place rounded down."""
        x, y, th = map(math.floor, place)
        self._sheet.inject(x, y, th, energy)

    def accept(self) -> None:
        """Accept the place that the packet jumped to."""

    def go_back(self) -> None:
        """Undo the jump: return to the place before it, moved on by odometry alone."""

    def numbers(self) -> Floats:
        """The state besides the cells, float64 (k,)."""
        return np.array(self._best)

    def restore(self, cells: Floats, numbers: Floats) -> None:
        """Restore ``cells`` and ``numbers``. Raises DataError, ShapeError."""
        _check_numbers(numbers, 3, self._sheet.activity.shape[1])
        _assign_cells(self._sheet, cells)
        self._best = Place(*numbers.tolist())


class SteadyNetwork:
    """One attractor step per ``step_s`` seconds or cell of distance, exact motion in between.

    The attractor pulls a packet towards cell centres, which makes it up to a fifth slower than
    the robot; smaller steps make it worse. Here the attractor only decides which packet wins:
    after each step the winner is put back to where odometry and views place it. The pose
    therefore does not depend on the rates of odometry and views. Heading 0 moves the packet
    along +x. Layers move in their own directions, so a longer step would tear the packet apart.

    Args:
        size: cells along x and y.
        global_inhibition: taken from every cell in each step.
        step_s: seconds.
    """

    def __init__(self, size: int, global_inhibition: float, step_s: float) -> None:
        self._sheet, self._size = PoseSheet(size), size
        self._inhibition, self._step_s = global_inhibition, step_s
        # _base: the packet's true place; _slip: the packet's offset from it; _way: motion since the
        # last step; _progress: the fraction of the current step done.
        self._base = Place(float(size // 2), float(size // 2), float(HEADINGS // 2))
        self._slip, self._way, self._progress = IDENTITY, IDENTITY, 0.0
        self._before: Place | None = None

    @property
    def best(self) -> Place:
        return wrap(compose(self._base, self._way), self._size)

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
        """Move every layer by the robot's motion, in the layer's own direction."""
        way, slip = self._way, self._slip
        sheet.move(
            _COSINES * way.x - _SINES * way.y + slip.x,
            _SINES * way.x + _COSINES * way.y + slip.y,
            way.th + slip.th,
        )

    def move(self, way: float, turn: float, dt: float) -> None:
        """Move the activity; steps do not depend on how odometry is divided into messages."""
        steps = max(dt / self._step_s, abs(way))
        if not steps:
            return
        if self._progress + steps > _MOST:
            self._advance(way, turn, 1.0)
            self._restart(self.best)
            self._progress = math.fmod(self._progress + steps, 1.0)
            return
        left = steps
        while self._progress + left >= 1 - 1e-9:
            part = min(max(1 - self._progress, 0.0), left)
            self._advance(way, turn, part / steps)
            self._step()
            left -= part
        self._advance(way, turn, left / steps)
        self._progress += left

    def _advance(self, way: float, turn: float, part: float) -> None:
        piece = motion_arc(way * part, turn * part)
        self._way = compose(self._way, piece)
        if self._before is not None:
            self._before = wrap(compose(self._before, piece), self._size)

    def _step(self) -> None:
        self._sheet.settle(self._inhibition)
        self._follow(self._sheet)
        here = self.best
        self._way, self._progress = IDENTITY, 0.0
        # The decoded packet is the expected one, slightly off, or another one.
        found = Place(*self._sheet.decode())
        slip = Place(*differences(here, found, self._size).tolist())
        if max(map(abs, slip)) < _JUMP:
            self._base, self._slip = here, slip
        else:
            self._before = self._before or wrap(compose(here, self._way), self._size)
            self._base, self._slip = found, IDENTITY

    def inject(self, place: Place, energy: float) -> None:
        """Spread energy over the cells around the place; the packet moves as far as its mean does.

        The winning packet is known after the next attractor step: until then the few cells that a
        view has just activated are more active than those of any packet.
        """
        place, slip = compose(place, inverse(self._way)), self._slip
        self._sheet.inject(place.x - slip.x, place.y - slip.y, place.th - slip.th, energy)
        self._sheet.assign(self._sheet.activity / (1 + energy))
        away = differences(place, self._base, self._size)
        if np.abs(away).max() <= _REACH:
            base = np.array(self._base) + away * (energy / (1 + energy))
            self._base = wrap(Place(*base.tolist()), self._size)

    def accept(self) -> None:
        self._before = None

    def go_back(self) -> None:
        if self._before is None:
            return
        self._restart(self._before)
        self._before = None

    def _restart(self, place: Place) -> None:
        """Reset the sheet to a single packet."""
        cells = np.zeros((HEADINGS, self._size, self._size))
        cells[0, 0, 0] = np.finfo(np.float64).tiny
        self._sheet.assign(cells)
        self._sheet.inject(*place, 1.0)
        for _ in range(_FORMED):
            self._sheet.settle(self._inhibition)
        self._base, self._way = place, IDENTITY
        off = differences(place, Place(*self._sheet.decode()), self._size)
        self._slip = Place(*off.tolist())

    def numbers(self) -> Floats:
        before = (math.nan,) * 3 if self._before is None else self._before
        return np.array([*self._base, *self._slip, *self._way, self._progress, *before])

    def restore(self, cells: Floats, numbers: Floats) -> None:
        _check_numbers(numbers, 13, self._size)
        _assign_cells(self._sheet, cells)
        values = numbers.tolist()
        self._base, self._slip, self._way = (Place(*values[i : i + 3]) for i in (0, 3, 6))
        self._progress = values[9]
        self._before = None if math.isnan(values[10]) else Place(*values[10:])


def _check_numbers(numbers: Floats, count: int, size: int) -> None:
    """Raise DataError unless the state is valid.

    It begins with a place on the sheet; after the tenth number is the place before a jump, or NaN.
    """
    if numbers.shape != (count,):
        raise DataError(f"network: numbers of the shape {numbers.shape}, expected {(count,)}")
    nowhere = count > 10 and bool(np.isnan(numbers[10:]).all())
    if not np.isfinite(numbers[:10] if nowhere else numbers).all():
        raise DataError(f"network: {numbers.tolist()}: expected finite numbers")
    if any(not 0 <= x < end for x, end in zip(numbers[:3], (size, size, HEADINGS), strict=True)):
        raise DataError(f"network: place {numbers[:3].tolist()} is not on the sheet")
    if not 0 <= numbers[9:10].sum() <= 1:
        raise DataError(f"network: {numbers[9]} of a step, expected 0 to 1")


def _assign_cells(sheet: PoseSheet, cells: Floats) -> None:
    expected = sheet.activity.shape
    if cells.shape != expected:
        raise ShapeError(f"the activity has cells of the shape {cells.shape}, expected {expected}")
    sheet.assign(cells)
