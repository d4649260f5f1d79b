# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Chapter 5 of Stastny 2022 up to section 5.7: every method in every world and frame, judged."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from benchmarks.theses.config import WITHOUT_SENSOR, ReproduceConfig
from benchmarks.theses.drives import Source
from benchmarks.theses.work_cache import WorkCache, load_json, save_json
from fusionslam.base.progress import Step
from fusionslam.errors import FusionSlamError
from fusionslam.evaluation import ViewCurve, ViewReport, ViewRun
from fusionslam.pipelines.compare_views import run_method
from fusionslam.pipelines.drives import FRAMES, FrameName, move_clouds
from fusionslam.pipelines.methods import Method, Task, find_method
from fusionslam.pipelines.views import sweep_thresholds
from fusionslam.report.views.tables import Row, view_row

Rule = str

RULES: dict[FrameName, Rule] = {"robot": "paper", "odometry": "author", "drift": "paper"}
"""Rule for each frame: the program's rule for the thesis's set-up, a strict one for ours."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of one method in one world and frame.

    Attributes:
        world: world of the thesis.
        frame: frame of the clouds.
        method: name of the method, as ``find_method`` takes it.
        run: with its curve if other thresholds were tried; None if not available.
        note: why there is no run.
    """

    world: str
    frame: FrameName
    method: str
    run: ViewRun | None
    note: str = ""

    @cached_property
    def report(self) -> ViewReport | None:
        """Report by the rule of the frame."""
        return None if self.run is None else self.run.judge(RULES[self.frame])

    @cached_property
    def row(self) -> Row | None:
        """All scalar figures."""
        if self.run is None or self.report is None:
            return None
        return view_row(self.run.method, self.report, self.run)


@dataclass(frozen=True)
class DriveFacts:
    """Facts about a drive.

    Attributes:
        world: world of the thesis.
        words: description of the drive.
        made: whether the world is simulated here.
        scans, dropped: number of scans with and without something above the floor.
        revisits: number of scans that return to a place after more than 20 s.
        seconds, metres: duration and length.
    """

    world: str
    words: str
    made: bool
    scans: int
    dropped: int
    revisits: int
    seconds: float
    metres: float


@dataclass(frozen=True)
class ViewStudy:
    """The drives through all worlds, and the results of every method."""

    drives: list[DriveFacts]
    outcomes: list[Outcome]

    def outcome(self, world: str, frame: FrameName, method: str) -> Outcome | None:
        """Return the result of one method; None if it was not requested."""
        wanted = (world, frame, method)
        found = (o for o in self.outcomes if (o.world, o.frame, o.method) == wanted)
        return next(found, None)

    def figure(self, world: str, frame: FrameName, method: str, name: str) -> float | None:
        """Return one figure of ``view_row``; None if undefined."""
        outcome = self.outcome(world, frame, method)
        return outcome.row[name] if outcome and outcome.row else None

    def notes(self) -> list[str]:
        """List the reasons for missing runs, one line each."""
        found = (
            f"{o.world}: {find_method(o.method).title}: {o.note}" for o in self.outcomes if o.note
        )
        return list(dict.fromkeys(found))


class _NotHad(FusionSlamError):
    """A method is not available here; its cells stay empty and give the reason."""


def study_views(
    config: ReproduceConfig, drives: Sequence[Source], pieces: WorkCache, step: Step | None
) -> ViewStudy:
    """Run every method in every frame on every drive; results already stored are reused.

    Raises:
        DataError: a drive cannot be simulated or read, or the folder cannot be written.
    """
    methods = list(dict.fromkeys([*config.views, WITHOUT_SENSOR]))
    outcomes = [
        _outcome(source, frame, method, pieces, step)
        for source in drives
        for method in methods
        for frame in FRAMES
    ]
    return ViewStudy([_facts(source, pieces) for source in drives], outcomes)


def _facts(source: Source, pieces: WorkCache) -> DriveFacts:
    def make() -> dict[str, Any]:
        scenes = source.drive.scenes
        poses = scenes.true_poses()
        counted = ViewRun("", "", np.arange(len(scenes)), poses, scenes.seconds).judge("paper")
        return {
            "scans": len(scenes),
            "dropped": source.drive.dropped,
            "revisits": counted.revisits,
            "seconds": float(np.ptp(scenes.seconds)),
            "metres": float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()),
        }

    known = {"source": source.identity}
    name = f"{source.world}-drive"
    facts = pieces.load_or_make(name, known, make, save_json, load_json, ".json")
    return DriveFacts(source.world, source.words, source.made, **facts)


def recognise_views(
    source: Source, frame: FrameName, method: str, pieces: WorkCache, step: Step | None
) -> Outcome:
    """Run one method in one world and frame, without its curve. Raises as ``study_views``."""
    task = _task(source, frame, method, step)
    try:
        run = pieces.load_or_make(
            f"{source.world}-{method}-{own_frame(frame, method)}",
            _identify(source, frame, method),
            lambda: _run_method(find_method(method), task()),
            ViewRun.save,
            ViewRun.load,
        )
    except _NotHad as missing:
        return Outcome(source.world, frame, method, None, str(missing))
    return Outcome(source.world, frame, method, run)


def own_frame(frame: FrameName, method: str) -> FrameName:
    """Return the frame a method runs in: the robot's if the frame makes no difference."""
    return "robot" if find_method(method).any_frame else frame


def _identify(source: Source, frame: FrameName, method: str) -> dict[str, Any]:
    return {"source": source.identity, "method": method, "frame": own_frame(frame, method)}


def _task(source: Source, frame: FrameName, method: str, step: Step | None) -> Callable[[], Task]:
    own, title = own_frame(frame, method), find_method(method).title
    return lambda: Task(title, source.drive, own, source.jobs, step)


def _outcome(
    source: Source, frame: FrameName, method: str, pieces: WorkCache, step: Step | None
) -> Outcome:
    """Run one method, with its curve if it has one and the odometry does not drift."""
    outcome, own = recognise_views(source, frame, method, pieces, step), own_frame(frame, method)
    # The thesis gives curves only for its own methods.
    known = find_method(method)
    compared = known.matcher is not None and known.published is not None
    swept = compared and frame != "drift" and own == frame
    if outcome.run is None or not swept:
        return outcome
    rule, task = RULES[frame], _task(source, frame, method, step)
    curve = pieces.load_or_make(
        f"{source.world}-{method}-{own}-curve",
        _identify(source, frame, method) | {"rule": rule},
        lambda: _sweep(method, task(), rule),
        ViewCurve.save,
        ViewCurve.load,
        ".json",
    )
    return replace(outcome, run=replace(outcome.run, curve=curve))


def _run_method(entry: Method, task: Task) -> ViewRun:
    run, note = run_method(entry, task)
    if run is None:
        raise _NotHad(note)
    return run


def _sweep(method: str, task: Task, rule: Rule) -> ViewCurve:
    """Compute precision and recall at other thresholds of the first stage."""
    make: Callable[[], Any] | None = find_method(method).matcher
    assert make is not None  # checked by the caller
    scenes = move_clouds(task.drive.scenes, task.frame)
    return sweep_thresholds(
        scenes, make().config, rule=rule, progress=task.progress("other thresholds")
    )
