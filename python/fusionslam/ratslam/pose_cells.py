# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``PoseCells``: where the robot is, as a packet of activity on a wrapped sheet (Milford 2004).

>>> cells = PoseCells(preset="openratslam")
>>> cells.on_view(0)
>>> cells.on_odometry(0.5, 0.0, 0.1)
>>> cells.action()
Action(kind=<ActionKind.CREATE_NODE: 1>, source=0, target=0, relative_rotation=0.0, ...)
"""

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.config import Section, merged, option
from fusionslam.errors import DataError
from fusionslam.ratslam.actions import Action, ActionKind

Floats = NDArray[np.float64]

HEADINGS = 36
"""Layers of the sheet: headings ten degrees apart."""
_REACH = 3
_OLDER_THAN = 10


class PoseCellsConfig(Section):
    """The sheet of cells and what moves activity on it; the defaults are the reference run's."""

    preset: Literal["robust", "openratslam"] = option(
        "robust", "robust (ours) or openratslam (Ball et al. 2013, as its program behaves)"
    )
    size: int = option(20, "cells along x and along y", ge=7, le=1000)
    cell_m: float = option(0.4, "side of a cell", unit="m", gt=0)
    inject: float = option(0.05, "energy that a recognised view adds", ge=0)
    restore: float = option(0.05, "what the decay of a view falls by with each view", ge=0)
    active_decay: float = option(1.0, "decay of a view at rest", ge=0)
    global_inhibition: float = option(2e-5, "taken from every cell in each step", ge=0)
    delta_pc: float = option(2.0, "an experience is another one from here on", unit="cells", gt=0)


class Place(NamedTuple):
    """A pose on the sheet in cells: x, y in [0, n), th in [0, 36)."""

    x: float
    y: float
    th: float


@dataclass
class _View:
    """Where a view was seen first, how worn it is, and its experiences."""

    place: Place
    decay: float
    experiences: list[int] = field(default_factory=list)


class PoseCells:
    """A continuous attractor network of pose cells.

    Args:
        config: None for the defaults.
        changes: values of the configuration that differ from it.

    Raises:
        ConfigError: an unknown key, or a value out of range.
    """

    def __init__(self, config: PoseCellsConfig | None = None, **changes: Any) -> None:
        self.config = merged(config or PoseCellsConfig(), changes)
        n = self.config.size
        self._activity = np.zeros((HEADINGS, n, n))
        self._activity[HEADINGS // 2, n // 2, n // 2] = 1.0
        self._best = Place(float(n // 2), float(n // 2), float(HEADINGS // 2))
        self._views: list[_View] = []
        self._view = self._previous = 0
        self._rotation = 0.0
        self._experiences: list[tuple[Place, int]] = []
        self._current = 0
        self._moved = self._seen = False

    @property
    def activity(self) -> Floats:
        """float64 (36, n, n) by th, y, x; not negative, its sum is 1. A view of the state."""
        return self._activity

    @property
    def best(self) -> Place:
        """The decoded pose in cells."""
        return self._best

    def state(self) -> dict[str, NDArray[Any]]:
        import pickle

        kept = {k: v for k, v in vars(self).items() if k != "config"}
        return {"all": np.frombuffer(pickle.dumps(kept), np.uint8)}

    def restore(self, state: dict[str, NDArray[Any]]) -> None:
        import pickle

        vars(self).update(pickle.loads(state["all"].tobytes()))

    def refuse(self, action: Action) -> Action:
        raise NotImplementedError

    def on_view(
        self,
        view_id: int,
        relative_rotation: float = 0.0,
        relative_place: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Take note of the view that the robot sees.

        Args:
            view_id: known, or the next one.
            relative_rotation: radians, counter-clockwise, that the robot is turned against it.

        Raises:
            DataError: an id that skips numbers or is negative, or a rotation that is not finite.
        """
        if not 0 <= view_id <= len(self._views):
            raise DataError(f"view {view_id}: expected 0 to {len(self._views)}, the next new one")
        if not np.isfinite(relative_rotation):
            raise DataError(f"view {view_id}: relative rotation {relative_rotation}")
        config = self.config
        if view_id == len(self._views):
            self._views.append(_View(self._best, config.active_decay))
        else:
            self._inject(view_id, relative_rotation)
        for view in self._views:
            view.decay = max(view.decay - config.restore, config.active_decay)
        self._previous, self._view = self._view, view_id
        self._rotation, self._seen = relative_rotation, True

    def _inject(self, view_id: int, rotation: float) -> None:
        config, view = self.config, self._views[view_id]
        if view_id == self._view:
            view.decay += config.active_decay
        energy = config.inject * (30 - np.exp(1.2 * view.decay)) / 30
        underflows = config.preset == "openratslam" and len(self._views) < _OLDER_THAN
        if energy <= 0 or not (underflows or view_id < len(self._views) - _OLDER_THAN):
            return
        layer = int(np.floor(view.place.th + rotation * HEADINGS / (2 * np.pi))) % HEADINGS
        self._activity[layer, int(view.place.y), int(view.place.x)] += energy

    def on_odometry(self, v: float, w: float, dt: float) -> None:
        """Move the activity: one step of the network.

        Args:
            v: metres a second forward.
            w: radians a second, counter-clockwise.
            dt: seconds.
        """
        config = self.config
        cells = _convolved(self._activity, 7, 1.0)
        cells = cells - _convolved(cells, 5, 2.0)
        cells = np.maximum(cells - config.global_inhibition, 0)
        cells /= cells.sum()
        cells = _shifted(cells, v * dt / config.cell_m)
        self._activity = _turned(cells, w * dt * HEADINGS / (2 * np.pi))
        self._best = _decoded(self._activity)
        self._moved = True

    def action(self) -> Action:
        """What the experience map has to do now; call it once after each step of odometry."""
        if not (self._moved and self._seen):
            return Action(ActionKind.NONE)
        source = self._current
        known = self._views[self._view].experiences
        if not self._experiences or not known:
            return self._created(source)
        far = self._distance(self._current) > self.config.delta_pc
        if not far and self._view == self._previous:
            return Action(ActionKind.NONE)
        others = [one for one in known if one != self._current]
        nearest = min(others, key=self._distance, default=None)
        if nearest is None or self._distance(nearest) >= self.config.delta_pc:
            if nearest is None and not far:
                return Action(ActionKind.NONE)
            return self._created(source)
        self._current = nearest
        self._previous = self._view
        return Action(ActionKind.CREATE_EDGE, source, nearest, self._rotation)

    def _created(self, source: int) -> Action:
        self._experiences.append((self._best, self._view))
        self._current = len(self._experiences) - 1
        self._views[self._view].experiences.append(self._current)
        self._previous = self._view
        return Action(ActionKind.CREATE_NODE, source, self._current, self._rotation)

    def _distance(self, experience: int) -> float:
        place = self._experiences[experience][0]
        n, turned = self.config.size, self._rotation * HEADINGS / (2 * np.pi)
        return float(
            np.sqrt(
                _wrapped(self._best.x - place.x, n) ** 2
                + _wrapped(self._best.y - place.y, n) ** 2
                + _wrapped(self._best.th - turned - place.th, HEADINGS) ** 2
            )
        )


def _wrapped(difference: float, period: int) -> float:
    around = abs(difference) % period
    return min(around, period - around)


def _convolved(cells: Floats, width: int, deviation: float) -> Floats:
    """The wrapped convolution with a Gaussian box, one axis after the other."""
    offsets = np.arange(width) - width // 2
    weights = np.exp(-(offsets**2) / (2 * deviation**2))
    weights /= weights.sum()
    for axis in range(3):
        cells = sum(
            weight * np.roll(cells, offset, axis)
            for weight, offset in zip(weights, offsets, strict=True)
        )
    return cells


def _shifted(cells: Floats, way: float) -> Floats:
    moved = np.empty_like(cells)
    for layer in range(HEADINGS):
        angle = layer * 2 * np.pi / HEADINGS + (np.pi if way < 0 else 0)
        dx, dy = abs(way) * np.sin(angle), abs(way) * np.cos(angle)
        ix, iy = int(np.floor(dx)), int(np.floor(dy))
        fx, fy = dx - ix, dy - iy
        row = np.roll(cells[layer], ix, 1)
        row = (1 - fx) * row + fx * np.roll(row, 1, 1)
        row = np.roll(row, iy, 0)
        moved[layer] = (1 - fy) * row + fy * np.roll(row, 1, 0)
    return moved


def _turned(cells: Floats, layers: float) -> Floats:
    whole = int(np.floor(layers))
    part = layers - whole
    rolled = np.roll(cells, whole, 0)
    return (1 - part) * rolled + part * np.roll(rolled, 1, 0)


def _decoded(cells: Floats) -> Place:
    top = np.unravel_index(int(cells.argmax()), cells.shape)
    offsets = np.arange(-_REACH, _REACH + 1)
    axes = [(start + offsets) % size for start, size in zip(top, cells.shape, strict=True)]
    box = cells[np.ix_(*axes)]
    found = []
    for axis, rows in enumerate(axes):
        size = cells.shape[axis]
        sums = box.sum(axis=tuple(other for other in range(3) if other != axis))
        # The reference counts cells from 1 here: its start comes out just below 10, and the cell
        # that a view injects into, the floor of it, is the one before.
        angles = (rows + 1) * 2 * np.pi / size
        mean = np.arctan2((sums * np.sin(angles)).sum(), (sums * np.cos(angles)).sum())
        found.append(float((mean * size / (2 * np.pi) - 1) % size))
    return Place(found[2], found[1], found[0])
