# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Compare place recognisers: tables 5.2 to 5.5 of Stastny 2022 for any drive.

drive = open_drive("recordings/warehouse.npz", render=rendered_images)
for result in bench_views([drive], ["objects:author", "visual_templates"], frames=["robot"]):
    print(result.title, result.paper.accuracy, result.paper.loop_recall)
"""

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fusionslam.base.progress import Step
from fusionslam.config import explain_choice
from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.evaluation import (
    PublishedViews,
    RerunViews,
    ViewReport,
    ViewRun,
    published_views,
    rerun_views,
)
from fusionslam.pipelines.drives import FRAMES, Drive, FrameName
from fusionslam.pipelines.methods import METHODS, Method, Task, find_method

logger = logging.getLogger(__name__)

DATA_VARIABLE = "FUSIONSLAM_TEST_DATA"


@dataclass(frozen=True, eq=False)
class ViewResult:
    """The result of one method on one drive, with the published figures to compare with.

    Attributes:
        drive: name of the drive.
        frame: frame of the clouds.
        method: name of the method, as ``find_method`` takes it.
        title: title of the table row.
        scans: number of scans of the drive, without empty ones.
        run: ids and costs; None if the method could not run.
        paper, author: evaluation of the run by these rules.
        published: the thesis's figures for the same method in the same world.
        rerun: figures of the thesis's program run again, for the same frame too.
        note: why there is no run.
    """

    drive: str
    frame: FrameName
    method: str
    title: str
    scans: int
    run: ViewRun | None = None
    paper: ViewReport | None = None
    author: ViewReport | None = None
    published: PublishedViews | None = None
    rerun: RerunViews | None = None
    note: str = ""


def bench_views(
    drives: Sequence[Drive],
    methods: Sequence[str] = tuple(METHODS),
    *,
    frames: Sequence[FrameName] = ("robot",),
    jobs: int = 1,
    step: Step | None = None,
) -> list[ViewResult]:
    """Run every method on every drive, in every frame, and evaluate the ids.

    A method that cannot run (an extra is missing, a drive has no images) has a result with a note
    and no run.

    Args:
        drives: with ground-truth poses.
        methods: names that ``find_method`` takes.
        frames: names from ``FRAMES``.
        jobs: number of images rendered in parallel; matching is timed and takes one scan at a
            time.
        step: progress callback.

    Raises:
        ConfigError: an unknown method or frame.
        DataError: two drives have the same name.
    """
    names = [drive.name for drive in drives]
    if twice := {name for name in names if names.count(name) > 1}:
        raise DataError(
            f"two drives are named {min(twice)}: copy or link one to another name",
            code="same-name",
            fields=(min(twice),),
        )
    found = {name: find_method(name) for name in methods}
    for frame in frames:
        if frame not in FRAMES:
            problem = explain_choice(frame, FRAMES)
            raise ConfigError(
                f"frame is {frame!r}, {problem}", code="choice", fields=("frame", frame)
            )
    for drive in drives:
        # Load every drive first, so that a bad one fails before any is compared.
        logger.info("%s: %d scans", drive.name, len(drive.scenes))
    results = []
    for drive in drives:
        of_any_frame: dict[str, tuple[ViewRun | None, str]] = {}
        for frame in frames:
            for name, method in found.items():
                task = Task(method.title, drive, frame, jobs, step)
                outcome = of_any_frame.get(name) or run_method(method, task)
                if method.any_frame:
                    of_any_frame[name] = outcome
                results.append(_result(name, method, task, *outcome))
    return results


def run_method(method: Method, task: Task) -> tuple[ViewRun | None, str]:
    """Return the run of a method and "", or None and the reason why it cannot run."""
    try:
        return method.run(task), ""
    except FusionSlamError as error:
        # A method that cannot run must not stop the others: the table says why.
        logger.warning("%s: no %s: %s", task.drive.name, task.title, error)
        return None, str(error)


def _result(name: str, method: Method, task: Task, run: ViewRun | None, note: str) -> ViewResult:
    drive = task.drive
    world = drive.world or ""
    published = [f for f in published_views(world) if f.method == method.published]
    rerun = [f for f in rerun_views(world) if f.input == method.rerun.get(task.frame)]
    return ViewResult(
        drive=drive.name,
        frame=task.frame,
        method=name,
        title=run.method if run else method.title,
        scans=len(drive.scenes),
        run=run,
        paper=run.judge("paper") if run else None,
        author=run.judge("author") if run else None,
        published=published[0] if published else None,
        rerun=rerun[0] if rerun else None,
        note=note,
    )


def find_recordings() -> list[str]:
    """Return the paths in ``recordings`` below the folder that FUSIONSLAM_TEST_DATA names."""
    folder = os.environ.get(DATA_VARIABLE)
    found = sorted(Path(folder).glob("recordings/*.npz")) if folder else []
    return [str(path) for path in found]
