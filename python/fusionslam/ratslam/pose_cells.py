# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``PoseCells``: the robot's pose as a packet of activity on a wrapped sheet (Milford 2004).

>>> cells = PoseCells(preset="openratslam")
>>> cells.on_view(0)
>>> cells.on_odometry(0.5, 0.0, 0.1)
>>> cells.action()
Action(kind=<ActionKind.CREATE_NODE: 1>, source=0, target=0, relative_rotation=0.0, ...)
"""

import math
import operator
from collections.abc import Mapping
from typing import Any, Literal, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import ActionKind
from fusionslam.base.argument_types import checked
from fusionslam.base.arrays import Floats
from fusionslam.base.growing_array import Rows
from fusionslam.config import Section, merged, option
from fusionslam.errors import DataError
from fusionslam.ratslam.attractor import (
    IDENTITY,
    LAYER,
    Place,
    ReferenceNetwork,
    SteadyNetwork,
    compose,
    differences,
    inverse,
    wrap,
)
from fusionslam.ratslam.experience_map import Action

INJECT = {"robust": 0.15, "openratslam": 0.05}
"""Energy of a view by preset: openratslam as in the reference run; with robust, five views in a
row win over a packet."""
_OLDER_THAN = 10
Arrays = Mapping[str, NDArray[Any]]

_VIEW_TABLES = {"places": (3,), "decays": (), "since": ()}
"""The tables with one row per view, and the shape of a row."""
_EXPERIENCE_TABLES = {"experiences": (3,), "views_of": (), "offsets": (3,)}
"""The tables with one row per experience, and the shape of a row."""
_FIXED: dict[str, tuple[int, ...]] = {"relative": (3,), "counts": (4,), "flags": (3,)}
_DTYPES = {"since": np.int64, "views_of": np.int64, "counts": np.int64, "flags": np.bool_}
_STATE = ("cells", "network", *_FIXED, *_VIEW_TABLES, *_EXPERIENCE_TABLES)
_TABLES = (*_VIEW_TABLES, *_EXPERIENCE_TABLES)
# Distances longer than this, in cells, do not resolve the place within a cell any more.
_FARTHEST = 1e9
# The decay at which a view has no energy left: 30 - exp(1.2 decay) is 0.
_EXHAUSTED = math.log(30) / 1.2


class PoseCellsConfig(Section):
    """The sheet of cells and its dynamics; the defaults are the reference run's."""

    preset: Literal["robust", "openratslam"] = option(
        "robust", "robust (ours) or openratslam (Ball et al. 2013, as its program behaves)"
    )
    size: int = option(20, "cells along x and along y", ge=7, le=1000)
    cell_m: float = option(0.4, "side of a cell", unit="m", gt=0, allow_inf_nan=False)
    inject: float | None = option(
        None,
        "energy that a recognised view adds to the activity, whose sum is 1; null: 0.15 with "
        "robust, 0.05 with openratslam",
        ge=0,
        le=10,
    )
    restore: float = option(
        0.05, "decay that a view recovers from with each arriving view", ge=0, allow_inf_nan=False
    )
    active_decay: float = option(1.0, "decay of a view at rest", ge=0, allow_inf_nan=False)
    global_inhibition: float = option(
        2e-5, "subtracted from every cell in each step of the attractor", ge=0, le=1e-3
    )
    delta_pc: float = option(
        2.0,
        "distance at which a new experience is created",
        unit="cells",
        gt=0,
        allow_inf_nan=False,
    )
    step_s: float = option(
        0.5,
        "robust: time between two steps of the attractor, which also takes one after every cell of "
        "distance; openratslam takes one with each odometry message",
        unit="s",
        ge=1e-3,
        le=3600,
    )


@checked
class PoseCells:
    """A continuous attractor network of pose cells.

    The two presets differ as follows:

    - ``openratslam`` takes one attractor step per odometry message, ``robust`` one every ``step_s``
      of stamped time and every cell of distance, with exact motion in between: the pose does not
      depend on the odometry rate, and nothing moves at dt 0.
    - Views: ``openratslam`` adds energy to one cell, for views older than the last ten or, while
      there are fewer than ten, for any; ``robust`` spreads it over the cells around the place, for
      views older than the last ten only, and a view that the robot keeps seeing decays only until
      it adds nothing.
    - Rotations and places relative to a match: ``openratslam`` turns the place by the rotation.
      ``robust`` takes both as the robot's pose in the view's frame, moves the place by it, and
      stores it with each experience, so that actions give the robot's pose relative to the node.
    - Steps of a cell or more: ``openratslam`` refuses them, ``robust`` accepts any.

    Args:
        config: None for the defaults.
        changes: configuration values to override.

    Raises:
        ConfigError: an unknown key, or a value out of range.
    """

    def __init__(self, config: PoseCellsConfig | None = None, **changes: Any) -> None:
        config = self.config = merged(config or PoseCellsConfig(), changes)
        self._robust = config.preset == "robust"
        self._energy = INJECT[config.preset] if config.inject is None else config.inject
        self._network: ReferenceNetwork | SteadyNetwork = (
            SteadyNetwork(config.size, config.global_inhibition, config.step_s)
            if self._robust
            else ReferenceNetwork(config.size, config.global_inhibition)
        )
        # For each view: its place, its decay, and the count of views when the decay was set.
        self._places, self._decays, self._since = Rows(np.float64, 3), Rows(np.float64), Rows(int)
        self._arrived = self._view = self._previous = 0
        # For each experience: the robot's place, its view, and the robot in the view's frame.
        self._experiences, self._views_of = Rows(np.float64, 3), Rows(int)
        self._offsets = Rows(np.float64, 3)
        self._known: list[Rows] = []
        self._relative, self._current = IDENTITY, 0
        self._moved = self._seen = self._in_doubt = False

    def __getstate__(self) -> dict[str, Any]:
        return {"config": self.config, "state": self.state()}

    def __setstate__(self, stored: Mapping[str, Any]) -> None:
        PoseCells.__init__(self, stored["config"])
        self.restore(stored["state"])

    def __repr__(self) -> str:
        sizes = " x ".join(str(size) for size in self.activity.shape)
        places = ", ".join(f"{value:.3g}" for value in self.best)
        return f"<PoseCells {self.config.preset}: {sizes} cells, best at {places}>"

    @property
    def activity(self) -> Floats:
        """A copy of the activity, float64 (36, n, n) by th, y, x; not negative.

        Its sum is 1; in the openratslam preset views add to it until the next odometry.
        """
        return self._network.activity

    @property
    def best(self) -> Place:
        """The decoded pose in cells."""
        return self._network.best

    @property
    def known_views(self) -> int:
        """Number of views that have been seen."""
        return len(self._places)

    def on_view(
        self,
        view_id: SupportsIndex,
        relative_rotation: float = 0.0,
        relative_place: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Process the view that the robot sees.

        Args:
            view_id: a known id, or the next one.
            relative_rotation: rotation of the robot relative to the view, radians,
                counter-clockwise.
            relative_place: position of the robot in the view's frame, metres, x forward and y to
                the left. The openratslam preset does not use it.

        Raises:
            DataError: an id that skips numbers or is negative, a rotation or place that is not
                finite. Nothing is changed.
        """
        known, relative = len(self._places), self._check_place(relative_rotation, relative_place)
        try:
            view = operator.index(view_id)
        except TypeError:
            raise DataError(f"view {view_id!r}: expected a whole number") from None
        if not 0 <= view <= known:
            raise DataError(f"view {view}: expected 0 to {known}, the next new one")
        self._decide()
        if view == known:
            place = self.best
            if self._robust:
                place = wrap(compose(place, inverse(relative)), self.config.size)
            self._places.append(place)
            self._decays.append(self.config.active_decay)
            self._since.append(self._arrived)
            self._known.append(Rows(int))
        else:
            self._recall(view, relative)
        self._arrived += 1
        self._previous, self._view = self._view, view
        self._relative, self._seen = relative, True

    def _check_place(self, rotation: float, place: tuple[float, float]) -> Place:
        try:
            x, y = place
            values = np.array((x, y, rotation), np.float64)
        except (TypeError, ValueError, OverflowError):
            raise DataError(
                f"relative rotation {rotation!r}, place {place!r}: expected a number and x, y"
            ) from None
        if not np.isfinite(values).all() or np.abs(values).max() > _FARTHEST * self.config.cell_m:
            raise DataError(
                f"relative rotation {rotation}, place {place}: expected finite numbers, "
                f"of no more than {_FARTHEST * self.config.cell_m:g}"
            )
        x, y = (values[:2] / self.config.cell_m).tolist() if self._robust else (0.0, 0.0)
        return Place(x, y, float(values[2]) / LAYER)

    def _recall(self, view: int, relative: Place) -> None:
        # The decay falls with each arriving view down to a minimum.
        fallen = self.config.restore * (self._arrived - int(self._since.all[view]))
        decay = max(float(self._decays.all[view]) - fallen, self.config.active_decay)
        if view == self._view:
            decay += self.config.active_decay
            self._set_decay(view, min(decay, _EXHAUSTED) if self._robust else decay)
        count = len(self._places)
        underflows = not self._robust and count < _OLDER_THAN
        if decay >= _EXHAUSTED or not (underflows or view < count - _OLDER_THAN):
            return
        energy = self._energy * (30 - math.exp(1.2 * decay)) / 30
        place = Place(*self._places.all[view].tolist())
        if self._robust:
            place = compose(place, relative)
        else:
            place = Place(place.x, place.y, place.th + relative.th)
        self._network.inject(place, energy)

    def _set_decay(self, view: int, decay: float) -> None:
        self._decays.all[view], self._since.all[view] = decay, self._arrived

    def on_odometry(self, v: float, w: float, dt: float) -> None:
        """Move the activity.

        Args:
            v: m/s forward.
            w: rad/s, counter-clockwise.
            dt: seconds.

        Raises:
            DataError: a value that is not finite, a negative dt, a distance of more than 1e9
                cells, or, in the openratslam preset, of a cell or more. Nothing is changed.
        """
        try:
            v, w, dt = float(v), float(w), float(dt)
        except (TypeError, ValueError, OverflowError):
            raise DataError(f"odometry v {v!r}, w {w!r}, dt {dt!r}: expected numbers") from None
        way, turn = v * dt / self.config.cell_m, w * dt
        if not (math.isfinite(v) and math.isfinite(w) and 0 <= dt < math.inf):
            raise DataError(
                f"odometry v {v}, w {w}, dt {dt}: expected finite numbers and dt of 0 or more"
            )
        if not max(abs(way), abs(turn)) <= _FARTHEST:
            raise DataError(
                f"odometry v {v}, w {w}, dt {dt}: a way of {way:.3g} cells and a turn of "
                f"{turn:.3g} rad, expected no more than {_FARTHEST:g}"
            )
        self._network.move(way, turn, dt)
        self._decide()
        self._moved = True

    def _decide(self) -> None:
        """Accept the last edge, which the caller has not refused."""
        if self._in_doubt:
            self._network.accept()
        self._in_doubt = False

    def action(self) -> Action:
        """The next action for the experience map; call once after each odometry step."""
        if not (self._moved and self._seen):
            return Action(ActionKind.NONE)
        known = self._known[self._view].all
        if not len(known):
            return self._create_node(self._current)
        far = self._distances([self._current])[0] > self.config.delta_pc
        if not far and self._view == self._previous:
            return Action(ActionKind.NONE)
        others = known[known != self._current]
        if not len(others):
            return self._create_node(self._current) if far else Action(ActionKind.NONE)
        distances = self._distances(others)
        nearest = int(distances.argmin())
        if distances[nearest] >= self.config.delta_pc:
            return self._create_node(self._current)
        return self._create_edge(int(others[nearest]))

    def _create_node(self, source: int) -> Action:
        target = len(self._experiences)
        self._experiences.append(self.best)
        self._views_of.append(self._view)
        self._offsets.append(self._relative)
        self._known[self._view].append(target)
        self._current, self._previous = target, self._view
        rotation = 0.0 if self._robust else self._relative.th * LAYER
        return Action(ActionKind.CREATE_NODE, source, target, rotation)

    def _create_edge(self, target: int) -> Action:
        source, self._current = self._current, target
        self._previous, self._in_doubt = self._view, True
        # The robot's pose by its match, in cells, in the frame of the target.
        way = self._relative
        if self._robust:
            offset = Place(*self._offsets.all[target].tolist())
            way = compose(inverse(offset), way)
        cell = self.config.cell_m
        rotation = math.remainder(way.th * LAYER, 2 * math.pi) if self._robust else way.th * LAYER
        place = (way.x * cell, way.y * cell)
        return Action(ActionKind.CREATE_EDGE, source, target, rotation, place)

    @checked
    def refuse(self, action: Action) -> Action:
        """Replace the last action, an edge that the map found to be wrong.

        If the packet had jumped, the robust preset also goes back to the place before the jump,
        moved on by odometry, and ignores the view until others have been seen.

        Args:
            action: the result of ``action()``, before any further odometry or view.

        Returns:
            A new experience of the same view at this place, reached from where the robot was.

        Raises:
            DataError: the action was not an edge, or not the last one.
        """
        if not self._in_doubt or action.target != self._current:
            raise DataError(f"{action.kind.name} to {action.target} is not the last edge")
        self._in_doubt = False
        self._network.go_back()
        if self._robust:
            self._set_decay(self._view, _EXHAUSTED)
        return self._create_node(action.source)

    def _distances(self, experiences: Any) -> Floats:
        """Distances in cells from the pose to the ones expected if these experiences match."""
        places = self._experiences.all[experiences]
        if self._robust:
            # Where the match of these experiences' view has the robot.
            offsets = self._offsets.all[experiences]
            heading = (places[:, 2] - offsets[:, 2]) * LAYER
            dx, dy = (np.array(self._relative[:2]) - offsets[:, :2]).T
            x = places[:, 0] + np.cos(heading) * dx - np.sin(heading) * dy
            y = places[:, 1] + np.sin(heading) * dx + np.cos(heading) * dy
            th = places[:, 2] - offsets[:, 2] + self._relative.th
            same = self._views_of.all[experiences] == self._view
            places = np.where(same[:, None], np.stack((x, y, th), axis=1), places)
        else:
            places = places + np.array((0, 0, self._relative.th))
        apart = differences(self.best, places, self.config.size)
        distances: Floats = np.sqrt((apart**2).sum(axis=-1))
        return distances

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything but the configuration that ``restore`` needs to resume exactly from here."""
        counts = (self._arrived, self._view, self._previous, self._current)
        return {
            "cells": self._network.cells,
            "network": self._network.numbers(),
            "relative": np.array(self._relative),
            "counts": np.array(counts, np.int64),
            "flags": np.array((self._moved, self._seen, self._in_doubt)),
            **{name: getattr(self, f"_{name}").all.copy() for name in _TABLES},
        }

    @checked
    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Resume from the ``state`` of cells with the same configuration.

        Raises:
            DataError: a missing array, or one of another shape or configuration; impossible values.
                Nothing is changed.
            ShapeError: another number of cells. Nothing is changed.
        """
        state, new = _check_state(state), PoseCells(self.config)
        new._network.restore(state["cells"], state["network"])
        new._relative = Place(*state["relative"].tolist())
        new._arrived, new._view, new._previous, new._current = state["counts"].tolist()
        new._moved, new._seen, new._in_doubt = state["flags"].tolist()
        for name in _TABLES:
            setattr(new, f"_{name}", Rows.of(state[name]))
        new._known = [Rows(int) for _ in range(len(new._places))]
        for experience, view in enumerate(new._views_of.all.tolist()):
            new._known[view].append(experience)
        vars(self).update(vars(new))


def _check_state(state: Arrays) -> dict[str, NDArray[Any]]:
    """Check arrays of a stored state, and return them with the right types.

    Raises:
        DataError: an array is missing, or has a wrong shape or impossible values.
    """
    missing = [name for name in _STATE if name not in state]
    if missing:
        raise DataError(f"pose cells: no array {missing[0]!r} in the state")
    arrays = {name: _check_type(name, np.asarray(state[name])) for name in _STATE}
    for name, shape in _FIXED.items():
        _check_shape(name, arrays[name], shape)
    views = _check_table(arrays, _VIEW_TABLES)
    experiences = _check_table(arrays, _EXPERIENCE_TABLES)
    arrived, view, previous, current = arrays["counts"]
    _check_range("counts", arrived, np.iinfo(np.int64).max)
    _check_range("counts", np.array((view, previous)), max(views, 1))
    _check_range("counts", current, max(experiences, 1))
    _check_range("views_of", arrays["views_of"], views)
    _check_range("since", arrays["since"], int(arrived) + 1)
    return arrays


def _check_type(name: str, array: NDArray[Any]) -> NDArray[Any]:
    dtype = np.dtype(_DTYPES.get(name, np.float64))
    if not np.can_cast(array.dtype, dtype, "safe"):
        raise DataError(f"pose cells: {name} is {array.dtype}, expected {dtype}")
    if name != "network" and array.dtype.kind == "f" and not np.isfinite(array).all():
        raise DataError(f"pose cells: {name} holds values that are not finite")
    return array.astype(dtype)


def _check_shape(name: str, array: NDArray[Any], shape: tuple[int, ...], why: str = "") -> None:
    if array.shape != shape:
        raise DataError(f"pose cells: {name} has the shape {array.shape}, expected {shape}{why}")


def _check_table(arrays: Arrays, tables: Mapping[str, tuple[int, ...]]) -> int:
    """The number of rows that all of these tables share."""
    first = next(iter(tables))
    count = len(arrays[first]) if arrays[first].ndim else 0
    for name, row in tables.items():
        _check_shape(name, arrays[name], (count, *row), f", with a row for each of {first}")
    return count


def _check_range(name: str, values: NDArray[Any], end: int) -> None:
    wrong = values[(values < 0) | (values >= end)]
    if wrong.size:
        raise DataError(f"pose cells: {name} holds {wrong.flat[0]}, expected 0 to {end - 1}")
