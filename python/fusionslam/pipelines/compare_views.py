# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Ways to recognise views side by side: the thesis's tables 5.2 to 5.5 for any drive.

drive = open_drive("recordings/warehouse.npz")
for result in bench_views([drive], ["first_stage", "templates"], frames=["robot"]):
    print(result.title, result.paper.accuracy, result.paper.loop_recall)
"""

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fusionslam.errors import ConfigError, DataError, FusionSlamError
from fusionslam.evaluation import (
    PublishedViews,
    RerunViews,
    ViewReport,
    ViewRun,
    published_views,
    rerun_views,
)
from fusionslam.pipelines.drives import FRAMES, Drive, FrameName, Step
from fusionslam.pipelines.methods import ENTRANTS, Entrant, Task

logger = logging.getLogger(__name__)

DATA_VARIABLE = "FUSIONSLAM_TEST_DATA"


@dataclass(frozen=True, eq=False)
class ViewResult:
    """What one way to recognise views gave on one drive, with what others say of it.

    Attributes:
        drive: its name.
        frame: of the clouds.
        method: name in ``ENTRANTS``.
        title: of the row.
        scans: of the drive, empty ones left out.
        run: ids and costs; None where there was none.
        paper, author: the run judged by these rules.
        published: the thesis's figures for the same method in the same world.
        rerun: those that were measured again, for the same frame, too.
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
    methods: Sequence[str] = tuple(ENTRANTS),
    *,
    frames: Sequence[FrameName] = ("robot",),
    jobs: int = 1,
    step: Step | None = None,
) -> list[ViewResult]:
    """Give every drive to every way, in every frame, and judge the ids.

    A way that cannot be had (an extra that is missing, a drive without images) has a result with
    a note and no run.

    Args:
        drives: with true poses.
        methods: of ``ENTRANTS``.
        frames: of ``FRAMES``.
        jobs: images rendered at a time; matching is timed, and done one scan at a time.
        step: told about progress.

    Raises:
        ConfigError: an unknown method or frame.
        DataError: two drives of one name.
    """
    names = [drive.name for drive in drives]
    if twice := {name for name in names if names.count(name) > 1}:
        raise DataError(f"two drives are named {min(twice)}: copy or link one to another name")
    _check("method", methods, tuple(ENTRANTS))
    _check("frame", frames, tuple(FRAMES))
    results = []
    for drive in drives:
        still: dict[str, tuple[ViewRun | None, str]] = {}
        for frame in frames:
            for method in methods:
                entrant = ENTRANTS[method]
                task = Task(entrant.title, drive, frame, jobs, step)
                found = still.get(method) or run_entrant(entrant, task)
                if entrant.any_frame:
                    still[method] = found
                results.append(_result(method, task, *found))
    return results


def _check(what: str, names: Sequence[str], known: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            raise ConfigError(f"{what} is {name!r}, expected one of {', '.join(known)}")


def run_entrant(entrant: Entrant, task: Task) -> tuple[ViewRun | None, str]:
    """What a way gave; or None, and why there is nothing."""
    try:
        return entrant.run(task), ""
    except FusionSlamError as error:
        # One way that cannot be had must not cost the others: the table says why.
        logger.warning("%s: no %s: %s", task.drive.name, task.title, error)
        return None, str(error)


def _result(method: str, task: Task, run: ViewRun | None, note: str) -> ViewResult:
    entrant, drive = ENTRANTS[method], task.drive
    world = drive.world or ""
    published = [f for f in published_views(world) if f.method == entrant.published]
    rerun = [f for f in rerun_views(world) if f.input == entrant.rerun.get(task.frame)]
    return ViewResult(
        drive=drive.name,
        frame=task.frame,
        method=method,
        title=run.method if run else entrant.title,
        scans=len(drive.scenes),
        run=run,
        paper=run.judged("paper") if run else None,
        author=run.judged("author") if run else None,
        published=published[0] if published else None,
        rerun=rerun[0] if rerun else None,
        note=note,
    )


def known_recordings() -> list[str]:
    """What is compared when nobody says what: recordings, where there are, else made worlds.

    Recordings are those in ``recordings`` below the folder that FUSIONSLAM_TEST_DATA names.
    """
    from fusionslam.sim.recordings import EMBEDDED

    folder = os.environ.get(DATA_VARIABLE)
    found = sorted(Path(folder).glob("recordings/*.npz")) if folder else []
    return [str(path) for path in found] or list(EMBEDDED)
