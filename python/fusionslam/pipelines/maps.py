# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Run RatSLAM over a whole recording and record everything that it does."""

import logging
import os
from collections.abc import Callable
from dataclasses import replace
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusionslam.base.files import delay_interrupts
from fusionslam.base.progress import Step as Progress
from fusionslam.base.progress import label_progress, reported
from fusionslam.base.texts import counted
from fusionslam.errors import DataError, FusionSlamError, ShapeError
from fusionslam.evaluation.maps.run import NO_NODE, REFUSED, RatSlamRun
from fusionslam.geometry.odometry_noise import DRIFT, OdometryConfig
from fusionslam.geometry.se2 import wrapped
from fusionslam.geometry.trajectory import Trajectory
from fusionslam.pipelines.drives import Drive, open_drive
from fusionslam.pipelines.map_events import RunEvents, Unreadable, events_of, expected_drift
from fusionslam.ratslam.events import Event
from fusionslam.ratslam.slam import RatSlam, RatSlamConfig, Step
from fusionslam.ratslam.view_sources import SourceOptions, build_view_source
from fusionslam.ratslam.visual_odometry import VisualOdometryConfig
from fusionslam.views.match import NO_VIEW

logger = logging.getLogger(__name__)

_FIT = attrgetter("error_m", "error_rad", "allowed_m", "allowed_rad")
_OF_THE_MAP = ("nodes", "node_stamps_ns", "node_views", "links")

# The first and last ground-truth poses apply to steps up to this long before and after them.
_BEYOND_S = 0.1

Watch = Callable[[Step, RatSlam, Event], None]
"""Called after each step, with the step, the ``RatSlam`` and the event."""


class Recovery(NamedTuple):
    """A robot that was carried, found again by loops that agree.

    Attributes:
        seconds: since odometry was interrupted; None if that was in an earlier run.
        refused: number of loops that were refused since then.
    """

    seconds: float | None
    refused: int

    def __str__(self) -> str:
        later = "" if self.seconds is None else f" {self.seconds:.1f} s later,"
        loops = counted(self.refused, "refused loop")
        return f"the robot was carried: found again{later} after {loops}"


class RunRecorder:
    """Steps a ``RatSlam`` and records what it does; ``record`` may be called at any time.

    A step is atomic: Ctrl-C never interrupts it half-way.

    Args:
        slam: new or resumed.
        events: its input.
        earlier: earlier run of the same ``slam``; the record begins with it.

    Attributes:
        recoveries: how the robot was found again, each time that it was carried.
    """

    def __init__(
        self, slam: RatSlam, events: RunEvents, *, earlier: RatSlamRun | None = None
    ) -> None:
        self.slam, self.events, self.earlier = slam, events, earlier
        self._steps: list[Step] = []
        self._activity: list[tuple[NDArray[np.float32], ...]] = []
        self._notes: list[str] = []
        self._refused: list[FusionSlamError] = []
        self.recoveries: list[Recovery] = []
        self._interrupted_ns: int | None = None
        self._refused_loops = 0

    @property
    def has_steps(self) -> bool:
        """Whether any step was made yet."""
        return bool(self._steps)

    def step(self, event: Event | Unreadable) -> Step | None:
        """Process an event; return None for a refused event, which is noted."""
        if isinstance(event, Unreadable):
            self._refuse(event.error)
            return None
        with delay_interrupts():
            try:
                step = self.slam.step(event)
            except (DataError, ShapeError) as error:
                self._refuse(error)
                return None
            self._keep(step)
        return step

    def _refuse(self, error: FusionSlamError) -> None:
        logger.info("%s: left out: %s", self.events.name, error)
        self._refused.append(error)
        self._notes.append(f"left out: {error}")

    def _keep(self, step: Step) -> None:
        self._steps.append(step)
        if step.looked:
            cells = self.slam.cells.activity
            sums = (cells.sum(axis=axes) for axes in ((1, 2), (0, 1), (0, 2)))
            self._activity.append(tuple(each.astype(np.float32) for each in sums))
        elif step.why and not step.action.kind:
            self._note(step, step.why)
        # Loops are refused since odometry was interrupted, until some agree.
        if step.interrupted:
            self._interrupted_ns, self._refused_loops = step.stamp_ns, 0
        self._refused_loops += step.refused is not None
        if step.found:
            since = self._interrupted_ns
            seconds = None if since is None else (step.stamp_ns - since) / 1e9
            self.recoveries.append(Recovery(seconds, self._refused_loops))
            self._note(step, str(self.recoveries[-1]))
            self._interrupted_ns, self._refused_loops = None, 0

    def _note(self, step: Step, text: str) -> None:
        self._notes.append(f"{step.stamp_ns / 1e9:.3f} s: {text}")

    def record(self) -> RatSlamRun:
        """Return the run so far. Raises the first refusal if no view was taken."""
        slam, steps = self.slam, self._steps
        looked = [step for step in steps if step.looked]
        if self._refused and not looked:
            raise self._refused[0]
        if self._refused:
            count = counted(len(self._refused), "event")
            logger.warning("%s: %s left out: %s", self.events.name, count, self._refused[0])
        if not steps:
            raise DataError(f"{self.events.name}: no events")
        headings, size, _ = slam.cells.activity.shape
        th, x, y = (
            np.array([sums[axis] for sums in self._activity], np.float32).reshape(-1, length)
            for axis, length in enumerate((headings, size, size))
        )
        refused = [
            (step.stamp_ns, step.refused.source, step.refused.target, *_FIT(step.loop))
            for step in steps
            if step.refused is not None and step.loop is not None
        ]
        run = RatSlamRun(
            name=self.events.name,
            views=slam.views.title if slam.views is not None else "given ids",
            odometry=self.events.odometry,
            preset=slam.preset,
            config=slam.config.model_dump(mode="json"),
            **_per_step(steps),
            truth=truth_at(self.events.truth, [step.stamp_ns for step in steps]),
            why=[step.why for step in looked],
            notes=list(self._notes),
            nodes=slam.map.nodes,
            node_stamps_ns=np.array(slam.memory.node_stamps_ns, np.int64),
            node_views=np.array(slam.memory.node_views, np.int64),
            links=slam.map.links,
            refused=np.array(refused, REFUSED),
            activity_th=th,
            activity_x=x,
            activity_y=y,
        )
        return run if self.earlier is None else join_runs(self.earlier, run)


def run_ratslam(
    source: Drive | str | os.PathLike[str],
    views: str = "alignment",
    odometry: str | None = None,
    config: RatSlamConfig | None = None,
    *,
    options: SourceOptions | None = None,
    errors: OdometryConfig = DRIFT,
    seen: VisualOdometryConfig | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> RatSlamRun:
    """Make a map of a recording.

    Args:
        source: a drive, or what ``open_drive`` takes.
        views: place recogniser, one of ``RECOGNISERS``.
        odometry: source of the motion, one of ``ODOMETRY``; None for the topic if there is one,
            else the ground truth.
        config: of the cells and the map; None for the defaults, with the drift expected of this
            odometry.
        options: how views are built.
        errors: odometry errors of "truth+noise".
        seen: configuration of "visual" odometry; None for the defaults.
        jobs: number of images rendered in parallel.
        progress: progress callback.
        watch: called after each step.

    Raises:
        DataError: the recording cannot be read, or lacks the requested data. ConfigError: an
            unknown name.
    """
    chosen = build_view_source(views, options)
    drive = source if isinstance(source, Drive) else open_drive(source, jobs=jobs, step=progress)
    events = events_of(drive, chosen, odometry, errors, seen=seen, jobs=jobs, progress=progress)
    config = config or RatSlamConfig.model_validate({"map": expected_drift(odometry)})
    recorder = RunRecorder(RatSlam(config, views=chosen), events)
    run_events(recorder, progress, watch)
    return recorder.record()


def run_events(
    recorder: RunRecorder, progress: Progress | None = None, watch: Watch | None = None
) -> None:
    """Process all events of a recorder, except those that its ``RatSlam`` has seen before.

    Args:
        recorder: keeps the steps made, even if this call is interrupted.
        progress: progress callback.
        watch: called after each step.

    Raises:
        DataError: the events are those of another recording and begin before the map's end.
    """
    _check_overlap(recorder)
    label = f"{recorder.events.name}: mapping"
    events = recorder.events.after(*recorder.slam.seen_ns)
    for event in reported(events, label_progress(progress, label), len(events)):
        step = recorder.step(event)
        if step is not None and watch is not None and not isinstance(event, Unreadable):
            watch(step, recorder.slam, event)


def _check_overlap(recorder: RunRecorder) -> None:
    """Refuse or log views that are earlier than the map's end, unless the map was made of them.

    A gap before the first view is logged, too: only loops can tell whether the robot was carried.
    """
    events, earlier, end_ns = recorder.events, recorder.earlier, recorder.slam.seen_ns[1]
    stamps_ns = events.look_stamps_ns
    if end_ns is None or not len(stamps_ns):
        return
    count = int(np.count_nonzero(stamps_ns <= end_ns))
    if not count:
        gap_ns = stamps_ns[0] - end_ns
        # Two parts of one recording are about as far apart as its views; one alone does not tell.
        if len(stamps_ns) > 1 and gap_ns > 2 * np.ptp(stamps_ns) / (len(stamps_ns) - 1):
            logger.warning(
                "%s begins %.1f s after the end of the map: it must be of the same place, and a "
                "robot that was carried in between is found once some loops agree",
                events.name,
                gap_ns / 1e9,
            )
        return
    mapped = np.empty(0, np.int64) if earlier is None else earlier.stamps_ns[earlier.is_view]
    # The map may lack some: those that could not be read.
    same = 2 * np.count_nonzero(np.isin(stamps_ns[:count], mapped)) >= count
    if same and earlier is not None and earlier.name == events.name:
        return
    message = (
        f"{events.name}: {count} of {len(stamps_ns)} views, from {stamps_ns[0] / 1e9:.3f} s on, "
        f"are earlier than the end of the map, {end_ns / 1e9:.3f} s"
    )
    if same or earlier is None:
        logger.warning("%s: they are left out", message)
        return
    raise DataError(
        f"{message}, and are not those that it was made of: a recording that continues a map has "
        "later stamps; --stamps bag takes the times at which a bag was written",
        code="stamps-overlap",
        fields=(events.name, str(count)),
    )


def join_runs(earlier: RatSlamRun, later: RatSlamRun) -> RatSlamRun:
    """Join the steps of two runs of the same ``RatSlam``; the map is that of the later one."""
    changes: dict[str, Any] = {}
    for name, value in vars(later).items():
        before = getattr(earlier, name)
        if name == "truth":
            # NaN in the steps of a run without.
            truths = [
                np.full((len(run), 3), np.nan) if run.truth is None else run.truth
                for run in (earlier, later)
            ]
            known = earlier.truth is not None or later.truth is not None
            changes[name] = np.concatenate(truths) if known else None
        elif name in ("why", "notes"):
            changes[name] = [*before, *value]
        elif isinstance(value, np.ndarray) and name not in _OF_THE_MAP:
            changes[name] = np.concatenate([before, value])
    return replace(later, **changes)


def truth_at(truth: Trajectory | None, stamps_ns: list[int]) -> NDArray[np.float64] | None:
    """float64 (n, 3): true poses at stamps, NaN where unknown; None if all are unknown."""
    if truth is None:
        return None
    poses = true_poses(truth, stamps_ns)
    missing = np.count_nonzero(np.isnan(poses[:, 0]))
    if missing:
        logger.warning("%d of %d steps have no true pose", missing, len(poses))
    return None if missing == len(poses) else poses


def true_poses(truth: Trajectory, stamps_ns: list[int]) -> NDArray[np.float64]:
    """float64 (n, 3): true x, y and heading in (-pi, pi] at stamps; NaN where unknown."""
    seconds = np.array(stamps_ns) / 1e9
    inside = np.clip(seconds, truth.seconds[0], truth.seconds[-1])
    known = np.abs(seconds - inside) <= _BEYOND_S
    places = np.stack(truth.places(inside), axis=1)
    places[:, 2] = wrapped(places[:, 2])
    return np.where(known[:, None], places, np.nan)


def _per_step(steps: list[Step]) -> dict[str, NDArray[Any]]:
    def column(kind: type, of: Callable[[Step], Any]) -> NDArray[Any]:
        return np.array([of(step) for step in steps], kind)

    return {
        "stamps_ns": column(np.int64, lambda step: step.stamp_ns),
        "is_view": column(np.bool_, lambda step: step.looked),
        "view_ids": column(np.int64, lambda s: NO_VIEW if s.view_id is None else s.view_id),
        "poses": column(np.float64, lambda step: step.pose),
        "dead_reckoning": column(np.float64, lambda step: step.dead_reckoning),
        "node_ids": column(np.int64, lambda s: NO_NODE if s.node is None else s.node),
        "offsets": column(np.float64, lambda step: step.offset),
        "actions": column(np.int64, lambda step: step.action[:3]),
        "cells": column(np.float64, lambda step: step.cells),
        "step_seconds": column(np.float64, lambda step: step.seconds),
    }
