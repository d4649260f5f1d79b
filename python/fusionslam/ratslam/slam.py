# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""``RatSlam``: builds a map from odometry and views (Milford & Wyeth 2004, Ball et al. 2013).

>>> from fusionslam.ratslam import Motion, RatSlam, Sighting
>>> slam = RatSlam()
>>> for event in (Motion(0, 0.5, 0.0), Sighting(0, 0), Motion(33_000_000, 0.5, 0.0)):
...     step = slam.step(event)
>>> step.why
'node 0 created from view 0'
"""

import copy
import io
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam._core import ActionKind
from fusionslam.base.archive import check_types, join_parts, load_archive, part_of, save_archive
from fusionslam.base.argument_types import checked
from fusionslam.base.files import PathLike
from fusionslam.base.timer import Stopwatch
from fusionslam.config import Section, merged, option
from fusionslam.errors import DataError
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.geometry.odometry_calibration import LoopCheck, OdometryCalibration
from fusionslam.ratslam.attractor import Place
from fusionslam.ratslam.events import (
    Event,
    Look,
    Sighting,
    check_sighting,
    is_looking,
    stamp_of,
)
from fusionslam.ratslam.experience_map import (
    Action,
    ExperienceMap,
    ExperienceMapConfig,
    Relaxation,
)
from fusionslam.ratslam.odometry import (
    FORGOTTEN_NS,
    Ground,
    Limits,
    MotionStep,
    Odometry2D,
    odometry_from,
    odometry_of,
    step_between,
)
from fusionslam.ratslam.pose_cells import PoseCells, PoseCellsConfig
from fusionslam.ratslam.view_sources import KINDS, MatcherSource, ViewSource
from fusionslam.views.match import NO_VIEW

FORMAT = "fusionslam.ratslam.1"
_PARTS = ("cells", "map", "alone")
_RUN, _VIEWS = "run", "views"

NOTHING = Action(ActionKind.NONE)

# Longest motion of one event in cells. openratslam moves cell by cell, so more would take too
# long on a robot; robust cells would refuse more, perhaps when a part is already applied.
_FARTHEST = {"openratslam": 300, "robust": 1e6}


class RatSlamConfig(Section):
    """RatSLAM: the cells, the map, and their connection."""

    preset: Literal["robust", "openratslam"] | None = option(
        None, "of cells and map: robust (ours) or openratslam (Ball et al. 2013); null: each one's"
    )
    cells: PoseCellsConfig = option(PoseCellsConfig(), "the pose cells")
    map: ExperienceMapConfig = option(ExperienceMapConfig(), "the experience map")
    gap: float = option(
        0.5,
        "gap of odometry that is noted; a velocity counts no longer than this",
        unit="s",
        gt=0,
        le=3600,
    )
    max_speed: float = option(
        50.0,
        "faster odometry is a jump, such as a restart of its node, and is ignored",
        unit="m/s",
        gt=0,
        le=1000,
    )
    max_silence: float = option(
        10.0,
        "after a longer silence of odometry the robot may have been carried, as after a restart",
        unit="s",
        gt=0,
    )
    ambiguous: int = option(
        3, "a view seen at this many other places is too ambiguous to override odometry", ge=1
    )
    calibrate: bool = option(
        True,
        "learn from views that measure the robot's pose how much too long odometry's distances and "
        "turns are (robust)",
    )


@dataclass(frozen=True)
class Step:
    """The result of one event.

    Attributes:
        stamp_ns: stamp of the event.
        view_id: id of the recognised view; None if the event has no view or nothing was recognised.
        action: the action applied to the map.
        node: id of the last node that the robot visited; None before the first one.
        pose: x, y in metres and heading in radians, on the map.
        offset: the pose in the node's frame; before the first node: the pose.
        dead_reckoning: the pose by odometry alone.
        cells: the pose decoded from the pose cells, in cells.
        loop: how well a loop fitted the map; None if none was found, or loops are not checked.
        why: what happened, as a sentence; empty if nothing did.
        refused: the edge that was not made because its loop did not fit.
        relaxation: how well links fit after relaxation; None if nothing was done.
        looked: True if the event had a view, recognised or not.
        interrupted: True if odometry was interrupted before the event: the robot may have been
            carried.
        found: True if loops that agree put a robot that was carried back on the map.
        seconds: time spent on view recognition, the cells and the map.
    """

    stamp_ns: int
    view_id: int | None
    action: Action
    node: int | None
    pose: Ground
    offset: Ground
    dead_reckoning: Ground
    cells: Place
    loop: LoopCheck | None = None
    why: str = ""
    refused: Action | None = None
    relaxation: Relaxation | None = None
    looked: bool = False
    interrupted: bool = False
    found: bool = False
    seconds: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0), compare=False)


@checked
class RatSlam:
    """Pose cells and an experience map that process events in the order of their stamps.

    Odometry moves the robot; images, clouds and other items go to the view source. ``StampOrder``
    sorts the events of several sensors.

    ``step``, ``forget_clock``, ``save`` and ``seen_ns`` may be called from several threads: each
    waits for a running step. Attributes are read within ``paused``. A ``RatSlam`` can be sent to
    another process.

    Args:
        config: None for the defaults.
        views: the view source, which recognises places; None if they come as ``Sighting``.
        changes: configuration values to override.

    Attributes:
        config: the configuration in use.
        cells: the pose cells.
        map: the experience map.
        views: the view source, which recognises places.
        alone: a map without nodes, for dead reckoning.
        calibration: what views say of odometry.
        memory: the rest of the state.

    Raises:
        ConfigError: an unknown key, or a value out of range.
    """

    def __init__(
        self,
        config: RatSlamConfig | None = None,
        *,
        views: ViewSource | None = None,
        **changes: Any,
    ) -> None:
        self.config = merged(config or RatSlamConfig(), changes)
        preset = {} if self.config.preset is None else {"preset": self.config.preset}
        self.cells = PoseCells(merged(self.config.cells, preset))
        self.map = ExperienceMap(merged(self.config.map, preset))
        self.views = views
        # A map without nodes follows odometry alone.
        self.alone = ExperienceMap(self.map.config)
        self.memory = Memory()
        drift = self.map.config
        self.calibration = OdometryCalibration(drift.drift_turn, drift.drift_heading)
        cells = self.cells.config
        farthest = _FARTHEST[cells.preset] * cells.cell_m
        self._limits = Limits(
            self.config.gap, self.config.max_speed, farthest, self.config.max_silence
        )
        self._lock = threading.RLock()

    def __getstate__(self) -> dict[str, Any]:
        with self._lock:
            return copy.deepcopy({k: value for k, value in vars(self).items() if k != "_lock"})

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        vars(self).update(state, _lock=threading.RLock())

    def __repr__(self) -> str:
        views = "given ids" if self.views is None else self.views.title
        return f"<RatSlam, views {views}: {self.map!r}>"

    @property
    def preset(self) -> str:
        """The preset of the map, which decides whether loops are checked."""
        return self.map.config.preset

    @property
    def seen_ns(self) -> tuple[int | None, int | None]:
        """Stamps of the last odometry and the last view; None before the first one."""
        with self._lock:
            odometry, looked_ns = self.memory.odometry, self.memory.looked_ns
        return None if odometry is None else odometry.stamp_ns, looked_ns

    def step(self, event: Event) -> Step:
        """Process the next event: odometry, a view, or a frame with both.

        Args:
            event: ``Odometry`` or ``Motion``; ``Frame``, ``Picture`` or ``Look``, which go to
                ``views``; or a ``Sighting``.

        Raises:
            DataError: a stamp earlier than the previous event's, odometry or views that are not
                later than the last ones, values that are not finite, a view id that skips numbers,
                or no view source. ShapeError: not an event, or the item has a wrong shape. Cells
                and map are then unchanged, except that the odometry of a frame with a bad image or
                cloud still counts.
        """
        watch = Stopwatch()
        with self._lock:
            odometry, motion = self._check(event)
            self._move(odometry, motion, watch)
            sighting = self._look(event, watch)
            if sighting is not None:
                self._apply_view(event, sighting, watch)
            done = self._act(motion, sighting, watch)
            return self._make_step(event, motion, sighting, done, watch)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Let no thread but this one step in the block, to read several attributes that agree."""
        with self._lock:
            yield

    def forget_clock(self) -> None:
        """Accept any stamp for the next event, for example when a bag or a simulation restarts.

        Cells and map stay, and so does the odometry frame: the robot is where its next odometry
        pose says.
        """
        with self._lock:
            known = self.memory.odometry
            self.memory.odometry = known and known._replace(stamp_ns=FORGOTTEN_NS)
            self.memory.newest_ns = self.memory.looked_ns = None

    @checked
    def save(self, path: PathLike, *, run: RatSlamRun | None = None) -> None:
        """Save one file atomically, from which ``load`` resumes exactly.

        Args:
            path: path of the file.
            run: the run so far, to be stored with it for ``load_run``.

        Raises:
            DataError: the file cannot be written.
        """
        with self._lock:
            about = {
                "config": self.config.model_dump(mode="json"),
                "views": None if self.views is None else self.views.kind,
                "memory": asdict(self.memory),
            }
            states = {part: getattr(self, part).state() for part in (*_PARTS, "calibration")}
            arrays: dict[str, NDArray[Any]] = join_parts(states)
            if self.views is not None:
                arrays[_VIEWS] = np.frombuffer(self.views.to_bytes(), np.uint8)
        if run is not None:
            stream = io.BytesIO()
            run.save(stream)
            arrays[_RUN] = np.frombuffer(stream.getvalue(), np.uint8)
        save_archive(path, FORMAT, about, arrays)

    @classmethod
    def load(cls, path: PathLike, *, views: ViewSource | None = None) -> "RatSlam":
        """Resume from what ``save`` wrote.

        Args:
            path: path of the file.
            views: an empty view source of the stored kind, if that is not one of ``KINDS``.

        Raises:
            DataError: the file is missing, truncated, damaged, of another version or has another
                view source; the message names it.
        """
        with load_archive(path, FORMAT, "a stored RatSLAM") as (about, arrays):
            views = _empty_source(about["views"], views)
            slam = cls(merged(RatSlamConfig(), about["config"]), views=views)
            for part in _PARTS:
                getattr(slam, part).restore(part_of(arrays, part))
            if slam.views is not None:
                slam.views.restore(arrays[_VIEWS].tobytes())
            memory = slam.memory = Memory.of(about["memory"])
            learned = part_of(arrays, "calibration")
            slam.calibration.restore(learned, slam.cells.known_views)
            counts = len(slam.map), len(memory.node_stamps_ns), len(memory.node_views)
            if len(set(counts)) > 1:
                raise DataError("{} nodes, {} stamps and {} views of nodes".format(*counts))
        return slam

    def _check(self, event: Event) -> tuple[Odometry2D | None, MotionStep | None]:
        stamp_ns, known = stamp_of(event), self.memory
        if isinstance(event, Sighting):
            check_sighting(event)
        if known.newest_ns is not None and stamp_ns < known.newest_ns:
            raise DataError(f"stamp {stamp_ns} ns: expected {known.newest_ns} ns or later")
        if is_looking(event) and stamp_ns == known.looked_ns:
            raise DataError(f"view at {stamp_ns} ns: expected a stamp later than the last view's")
        odometry = odometry_of(event)
        motion = None if odometry is None else step_between(known.odometry, odometry, self._limits)
        return odometry, motion

    def _move(
        self, odometry: Odometry2D | None, motion: MotionStep | None, watch: Stopwatch
    ) -> None:
        cells = self.cells.config
        if motion is not None:
            if motion.interrupted:
                self.map.mark_interruption()
                self.calibration.forget()
            for v, w, dt in motion.legs:
                self.calibration.move(v * dt, w * dt)
                self.alone.on_odometry(v, w, dt)
                v, w = v * self.calibration.factors.way, w * self.calibration.factors.turn
                # openratslam takes less than a cell at a time.
                pieces = 1 if cells.preset == "robust" else int(abs(v * dt) / cells.cell_m) + 1
                with watch.measure("cells"):
                    for _ in range(pieces):
                        self.cells.on_odometry(v, w, dt / pieces)
                with watch.measure("map"):
                    self.map.on_odometry(v, w, dt)
            self.memory.moved = True
        if odometry is not None:
            # The original compares single scans.
            if isinstance(self.views, MatcherSource) and self.preset == "robust":
                self.views.follow(odometry)
            self.memory.odometry, self.memory.newest_ns = odometry, odometry.stamp_ns

    def _look(self, event: Event, watch: Stopwatch) -> Sighting | None:
        if not is_looking(event):
            return None
        if isinstance(event, Sighting):
            return event
        if self.views is None:
            raise DataError(f"view at {event.stamp_ns} ns: no view source to recognise it (views=)")
        with watch.measure("view"):
            item = event.item if isinstance(event, Look) else event
            return self.views.look(item, event.stamp_ns)

    def _apply_view(self, event: Event, sighting: Sighting, watch: Stopwatch) -> None:
        if sighting.view_id != NO_VIEW:
            with watch.measure("cells"):
                self.cells.on_view(
                    sighting.view_id, sighting.relative_rotation, sighting.relative_place
                )
            self.memory.view = int(sighting.view_id)
            with watch.measure("map"):
                self._calibrate(sighting)
        self.memory.looked_ns = self.memory.newest_ns = int(event.stamp_ns)

    def _calibrate(self, sighting: Sighting) -> None:
        """Learn from a view how much too long odometry is, and correct the map so far."""
        view_id = int(sighting.view_id)
        if view_id == len(self.calibration):
            self.calibration.store()
        elif self.config.calibrate and self.preset == "robust" and sighting.measures_place:
            pose = (*sighting.relative_place, sighting.relative_rotation)
            changed = self.calibration.observe([(view_id, pose)])
            if changed is not None:
                self.map.rescale_odometry(*changed)
                self.map.relax(whole=True)

    def _act(
        self, motion: MotionStep | None, sighting: Sighting | None, watch: Stopwatch
    ) -> "_ActionResult":
        # openratslam cells act on odometry only: on a view with the odometry after it.
        if motion is None and (sighting is None or self.cells.config.preset == "openratslam"):
            return _ActionResult(NOTHING)
        with watch.measure("cells"):
            action = self.cells.action()
        if not action.kind:
            return _ActionResult(action)
        with watch.measure("map"):
            done = self._check_action(action)
            self.map.apply(done.action)
            # Before nodes are moved, which Ctrl-C may interrupt: each node needs a stamp and view.
            if done.action.kind == ActionKind.CREATE_NODE:
                self.memory.node_stamps_ns.append(self.memory.newest_ns or 0)
                self.memory.node_views.append(self.memory.view)
            return done._replace(relaxation=self.map.relax())

    def _check_action(self, action: Action) -> "_ActionResult":
        """Replace an edge that does not fit the map by a new node."""
        if action.kind != ActionKind.CREATE_EDGE or self.preset == "openratslam":
            return _ActionResult(action)
        loop = self.map.check(action)
        fits = loop.fits
        if loop.accepted and not fits:  # accepted because other loops agree
            loop = self._check_ambiguity(action, loop)
        if loop.accepted:
            # Of a robot that was carried loops lead to nodes before the interruption of odometry.
            lost = [] if fits else self.map.state()["interruptions"][-1:].tolist()
            return _ActionResult(action, loop, found=any(action.target < node for node in lost))
        return _ActionResult(self.cells.refuse(action), loop, refused=action)

    def _check_ambiguity(self, action: Action, loop: LoopCheck) -> LoopCheck:
        """Refuse a loop against odometry if its view is seen all over the map.

        Where everything looks the same, wrong loops agree with each other.
        """
        places = self.map.nodes[:, :2]
        alike = places[np.array(self.memory.node_views) == self.memory.view]
        apart = np.linalg.norm(alike - places[action.target], axis=1)
        elsewhere = int(np.count_nonzero(apart > loop.error_m / 2))
        if elsewhere < self.config.ambiguous:
            return loop
        reason = f"{loop.reason}; but the view was seen at {elsewhere} other places"
        return loop._replace(accepted=False, reason=reason)

    def _make_step(
        self,
        event: Event,
        motion: MotionStep | None,
        sighting: Sighting | None,
        done: "_ActionResult",
        watch: Stopwatch,
    ) -> Step:
        known = sighting is not None and sighting.view_id != NO_VIEW
        return Step(
            stamp_ns=int(event.stamp_ns),
            view_id=int(sighting.view_id) if sighting is not None and known else None,
            action=done.action,
            node=self.map.current if self.memory.node_views else None,
            pose=self.map.pose,
            offset=self.map.offset,
            dead_reckoning=self.alone.pose,
            cells=self.cells.best,
            loop=done.loop,
            why="; ".join(filter(None, self._reasons(motion, sighting, done))),
            refused=done.refused,
            relaxation=done.relaxation,
            looked=sighting is not None,
            interrupted=motion is not None and motion.interrupted,
            found=done.found,
            seconds=(watch.total("view"), watch.total("cells"), watch.total("map")),
        )

    def _reasons(
        self, motion: MotionStep | None, sighting: Sighting | None, done: "_ActionResult"
    ) -> Iterator[str]:
        """Sentences that say what happened."""
        yield motion.note if motion is not None else ""
        if sighting is not None:
            known = sighting.view_id != NO_VIEW
            plain = f"view {sighting.view_id}" if known else "nothing recognised"
            yield sighting.reason or plain
            yield "" if self.memory.moved else "no odometry yet, so it is not on the map"
        if done.refused is not None and done.loop is not None:
            yield f"no loop to node {done.refused.target}: {done.loop.reason}"
        if done.action.kind == ActionKind.CREATE_NODE:
            yield f"node {done.action.target} created from view {self.memory.view}"
        elif done.action.kind == ActionKind.CREATE_EDGE:
            yield f"back at node {done.action.target}, from node {done.action.source}"


def load_run(path: PathLike) -> RatSlamRun | None:
    """Load the run that ``RatSlam.save`` stored with a map; None if there is none.

    Raises:
        DataError: as ``RatSlam.load``.
    """
    with load_archive(path, FORMAT, "a stored RatSLAM") as (_, arrays):
        return RatSlamRun.load(io.BytesIO(arrays[_RUN].tobytes())) if _RUN in arrays else None


def _empty_source(kind: str | None, given: ViewSource | None) -> ViewSource | None:
    """An empty view source of a stored kind. Raises DataError for an unknown kind."""
    if given is not None:
        if given.kind != kind:
            raise DataError(f"the view source is {kind or 'none'}, expected {given.kind}")
        return given
    if kind is None:
        return None
    if kind not in KINDS:
        raise DataError(f"unknown view source {kind}: pass one of this kind (views=)")
    return KINDS[kind]()


class _ActionResult(NamedTuple):
    """The action applied to the map, the check of its loop, and the refused edge.

    ``found`` tells whether the loop puts a robot that was carried back on the map.
    """

    action: Action
    loop: LoopCheck | None = None
    refused: Action | None = None
    relaxation: Relaxation | None = None
    found: bool = False


@dataclass
class Memory:
    """The state of a ``RatSlam`` besides its cells and its map.

    Attributes:
        odometry: the last odometry.
        newest_ns: stamp of the newest event.
        looked_ns: stamp of the last view, recognised or not.
        view: id of the last recognised view; -1 before the first.
        moved: True once odometry has given a motion.
        node_stamps_ns, node_views: time of creation and view of each node.
    """

    odometry: Odometry2D | None = None
    newest_ns: int | None = None
    looked_ns: int | None = None
    view: int = NO_VIEW
    moved: bool = False
    node_stamps_ns: list[int] = field(default_factory=list)
    node_views: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "Memory":
        """Rebuild from ``asdict`` values read from JSON."""
        odometry = odometry_from(values["odometry"])
        return check_types(cls(**{**values, "odometry": odometry}))
