# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""A step of RatSLAM's pose cells on a drive in laps like that of the reference run."""

import itertools
import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve

from benchmarks.speed.cases import Agreement, Bound, Case, agree
from benchmarks.speed.inputs import Inputs
from benchmarks.speed.settings import Settings
from benchmarks.speed.timing import Timer
from fusionslam.ratslam import PoseCells

PEER = "SciPy's ndimage.convolve, NumPy"
PUBLISHED = "the C++ original takes 0.47 ms"

SIZE, HEADINGS, CELL_M = 20, 36, 0.4  # as in the reference run, like what follows
INJECT, OLDER_THAN, INHIBITION = 0.05, 10, 2e-5
PERIOD = np.array((SIZE, SIZE, HEADINGS))

Floats = NDArray[np.float64]


class Moment(NamedTuple):
    """A view and the odometry after it: m/s, rad/s, s."""

    view: int
    v: float
    w: float
    dt: float


def pose_cell_cases(inputs: Inputs, settings: Settings) -> Iterator[Case]:
    """The reference's step against the straightforward one, then ours."""
    what = f"pose-cell step, {HEADINGS} x {SIZE} x {SIZE}"
    bound = Bound("median", "<=", 0.45)
    yield Case(
        f"{what}, openratslam ({PUBLISHED})",
        PEER,
        _steps(PoseCells(preset="openratslam")),
        _steps(StraightforwardCells()),
        lambda: _same(settings.pose_cell_steps),
        bound,
    )
    yield Case(
        f"{what}, robust",
        "",
        _steps(PoseCells(preset="robust")),
        None,
        lambda: _like_odometry(settings.pose_cell_steps),
        bound,
    )


def laps() -> Iterator[Moment]:
    """Round and round 20 m by 10 m at 0.5 m/s, 10 Hz, a view every metre, some noise."""
    random = np.random.default_rng(0)
    straight, corner = 0.5, math.pi / 2
    lap = ([0.0] * 400 + [corner] * 10 + [0.0] * 200 + [corner] * 10) * 2
    for step, w in enumerate(itertools.cycle(lap)):
        v = straight * (0.2 if w else 1.0)
        noise = random.normal(scale=(0.01, 0.01))
        yield Moment(step % len(lap) // 20, v + noise[0], w + noise[1], 0.1)


class StraightforwardCells:
    """The step of Ball et al. (2013) as one would write it with SciPy, without actions."""

    def __init__(self) -> None:
        self.activity = np.zeros((HEADINGS, SIZE, SIZE))
        self.activity[HEADINGS // 2, SIZE // 2, SIZE // 2] = 1
        self.best = np.array((SIZE // 2, SIZE // 2, HEADINGS // 2), np.float64)
        self._excite, self._inhibit = _box(7, 1), _box(5, 2)
        self._places: list[Floats] = []
        self._decays: list[float] = []
        self._view = 0

    def on_view(self, view: int) -> None:
        """Learn where it is, or inject."""
        if view == len(self._places):
            self._places.append(self.best)
            self._decays.append(1.0)
        else:
            self._decays[view] += view == self._view
            energy = INJECT * (30 - math.exp(1.2 * self._decays[view])) / 30
            count = len(self._places)
            if energy > 0 and (count < OLDER_THAN or view < count - OLDER_THAN):
                x, y, th = np.floor(self._places[view]).astype(int)
                self.activity[th, y, x] += energy
        self._decays = [max(decay - 0.05, 1.0) for decay in self._decays]
        self._view = view

    def on_odometry(self, v: float, w: float, dt: float) -> None:
        """Excite, inhibit, normalise, move, turn, decode."""
        cells = convolve(self.activity, self._excite, mode="wrap")
        cells -= convolve(cells, self._inhibit, mode="wrap")
        cells = np.maximum(cells - INHIBITION, 0)
        cells /= cells.sum()
        way = v * dt / CELL_M
        for th in range(HEADINGS):
            angle = th * 2 * math.pi / HEADINGS
            cells[th] = _shifted(cells[th], way * math.cos(angle), 0)
            cells[th] = _shifted(cells[th], way * math.sin(angle), 1)
        self.activity = _shifted(cells, w * dt * HEADINGS / (2 * math.pi), 0)
        self.best = _decoded(self.activity)

    def action(self) -> None:
        """What the map would have to do is left out: ours does more."""


def _shifted(cells: Floats, way: float, axis: int) -> Floats:
    whole = math.floor(way)
    near, far = (np.roll(cells, shift, axis) for shift in (whole, whole + 1))
    shifted: Floats = (1 - way + whole) * near + (way - whole) * far
    return shifted


def _box(width: int, deviation: float) -> Floats:
    grid = np.indices((width,) * 3) - width // 2
    weights = np.exp(-(grid**2).sum(axis=0) / (2 * deviation**2))
    box: Floats = weights / weights.sum()
    return box


def _decoded(cells: Floats) -> Floats:
    """Circular means over the box of seven cells a side round the largest one: x, y, th."""
    top = np.unravel_index(int(cells.argmax()), cells.shape)
    axes = [(at + np.arange(-3, 4)) % n for at, n in zip(top, cells.shape, strict=True)]
    box = cells[np.ix_(*axes)]
    place = []
    for axis, (at, n) in enumerate(zip(axes, cells.shape, strict=True)):
        sums = box.sum(axis=tuple({0, 1, 2} - {axis}))
        mean = np.angle((sums * np.exp(2j * math.pi * (at + 1) / n)).sum())
        place.append((mean * n / (2 * math.pi) - 1) % n)
    return np.array(place[::-1])


def _advance(cells: PoseCells | StraightforwardCells, moment: Moment) -> None:
    cells.on_view(moment.view)
    cells.on_odometry(moment.v, moment.w, moment.dt)
    cells.action()


def _steps(cells: PoseCells | StraightforwardCells) -> Timer:
    """Times the next step of the drive."""
    drive = laps()

    def measure() -> float:
        moment = next(drive)
        begin = time.perf_counter()
        _advance(cells, moment)
        return time.perf_counter() - begin

    return measure


def _same(steps: int) -> Agreement:
    ours, theirs = PoseCells(preset="openratslam"), StraightforwardCells()
    for moment in itertools.islice(laps(), steps):
        _advance(ours, moment)
        _advance(theirs, moment)
    error = np.abs(ours.activity - theirs.activity).max()
    return agree(f"largest difference of a cell after {steps} steps", float(error), 1e-9)


def _like_odometry(steps: int) -> Agreement:
    ours, heading = PoseCells(preset="robust"), math.pi
    place = complex(SIZE // 2, SIZE // 2)
    for moment in itertools.islice(laps(), steps):
        _advance(ours, moment)
        turn = moment.w * moment.dt
        chord = moment.v * moment.dt * np.sinc(turn / (2 * math.pi)) / CELL_M
        place += chord * np.exp(1j * (heading + turn / 2))
        heading += turn
    expected = (place.real, place.imag, heading * HEADINGS / (2 * math.pi))
    away = (np.array(ours.best) - expected + PERIOD / 2) % PERIOD - PERIOD / 2
    words = f"cells from where odometry leads after {steps} steps"
    return agree(words, float(np.abs(away).max()), 1e-6)
