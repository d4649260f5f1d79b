# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command ratslam: maps of recordings."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.failures import INTERRUPTED, needs_extra
from fusionslam.cli.views.options import build_config
from fusionslam.storage.files import made_folder
from fusionslam.storage.progress import Step

if TYPE_CHECKING:
    from fusionslam.evaluation.maps.run import RatSlamRun
    from fusionslam.pipelines.map_events import RunEvents
    from fusionslam.pipelines.maps import RunRecorder, Watch
    from fusionslam.pipelines.recording import Recording
    from fusionslam.ratslam.slam import RatSlam

_OF_THE_STATE = ("ratslam.", "views.", "visual_templates.", "fusion.", "descriptors.")


@opt.reading_options()
def ratslam(
    *,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for what is written.")],
    views: Annotated[
        str | None,
        typer.Option(
            "--views",
            help="What recognises places: alignment (default), objects, two_stages, cm2dp, "
            "visual_templates, ...",
        ),
    ] = None,
    odometry: Annotated[
        str | None,
        typer.Option(
            "--odometry",
            help="What tells the motion: topic, visual, truth or truth+noise; else the topic where "
            "there is one, or the truth.",
        ),
    ] = None,
    preset: Annotated[
        str | None, typer.Option("--preset", help="robust (ours, the default) or openratslam.")
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed", min=0, help="Decides the noise of --odometry truth+noise, where it has some."
        ),
    ] = None,
    save: Annotated[
        Path | None,
        typer.Option("--save", metavar="STATE", help="Write a file that --resume goes on from."),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="STATE", help="Go on with the map that --save wrote."),
    ] = None,
    live: Annotated[
        str | None,
        typer.Option(
            "--live",
            metavar="FILE.rrd",
            help='Show the map as it grows, in a file for the viewer of rerun; "viewer" opens it.',
        ),
    ] = None,
    recording: "Recording",
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    no_report: Annotated[
        bool, typer.Option("--no-report", help="Write no page, which takes a while.")
    ] = False,
    verbose: opt.Verbose = False,
) -> None:
    """Make a map of where a robot was, of its odometry and the places that it recognises.

    Ctrl-C keeps the map so far, and what is needed to go on with it.
    """
    from contextlib import suppress

    from fusionslam.config import merged
    from fusionslam.errors import DataError
    from fusionslam.pipelines.drives import open_drive
    from fusionslam.pipelines.map_events import ODOMETRY, events_of, expected_drift
    from fusionslam.pipelines.maps import RunRecorder
    from fusionslam.sim.rendered_images import rendered_images

    if not no_report:
        needs_extra("report")
    if live is not None:
        needs_extra("live")
    changes = [*([f"ratslam.preset={preset}"] if preset else []), *(settings or [])]
    changes += [f"odometry.seed={seed}"] if seed is not None else []
    if odometry is not None:
        opt.one_of("--odometry", odometry, ODOMETRY)
    first = {"recording": {"shapes": "collision"}, "ratslam": {"map": expected_drift(odometry)}}
    whole = build_config(None, config, changes, **first)
    # A recording of images alone has no clouds; views that need them fail later.
    with suppress(DataError):
        whole = merged(whole, {"fusion": {"source": opt.source_of(None, whole, recording)}})
    slam, earlier = _mapper(whole, views, resume, changes)
    with made_folder(output), ExitStack() as shown:
        with progress() as step:
            drive = open_drive(
                recording,
                ranges=whole.recording,
                render=rendered_images,
                jobs=opt.cores(jobs),
                step=step,
            )
            assert slam.views is not None  # holds for every named source
            events = events_of(
                drive,
                slam.views,
                odometry,
                whole.odometry,
                seen=whole.visual_odometry,
                jobs=opt.cores(jobs),
                progress=step,
            )
            recorder = RunRecorder(slam, events, earlier=earlier)
            watch = shown.enter_context(_live(live, events))
            interrupted = _interrupted(recorder, step, watch)
        # Before the live view is closed, so that the map is kept even if its file fails.
        _finish(recorder, output, save, interrupted=interrupted, no_report=no_report)


def _finish(
    recorder: "RunRecorder", output: Path, save: Path | None, *, interrupted: bool, no_report: bool
) -> None:
    """Write everything and say where; for an interrupted run also how to resume."""
    run = recorder.record()
    if interrupted:
        save = save or output / "state.npz"
    _write(run, recorder.slam, output, save)
    print(_page(run, output, no_report or interrupted))
    if interrupted:
        typer.echo(f"interrupted: --resume {save} goes on from there", err=True)
        raise typer.Exit(INTERRUPTED)


@contextmanager
def _live(live: str | None, events: "RunEvents") -> "Iterator[Watch | None]":
    """Yield the function that shows each step live; None without --live."""
    if live is None:
        yield None
        return
    from fusionslam.report.maps.rerun_view import LiveView

    path = None if live == "viewer" else live
    with LiveView(path, events.name, events.truth) as view:
        yield view.step


def _mapper(
    whole: Any, views: str | None, resume: Path | None, settings: list[str]
) -> "tuple[RatSlam, RatSlamRun | None]":
    """Return a new map, or a resumed one with its earlier run."""
    from fusionslam.errors import ConfigError
    from fusionslam.ratslam.slam import RatSlam, load_run
    from fusionslam.ratslam.view_sources import SourceOptions, build_view_source
    from fusionslam.views.recognisers import find_recogniser, method_of

    if views is not None:
        find_recogniser(views, "--views")
    if resume is None:
        options = SourceOptions(
            whole.views, whole.fusion, whole.descriptors, whole.visual_templates
        )
        name = views or method_of(whole.views)
        return RatSlam(whole.ratslam, views=build_view_source(name, options)), None
    given = ["--views"] * (views is not None)
    given += [text for text in settings if text.startswith(_OF_THE_STATE)]
    if given:
        raise ConfigError(f"{given[0]}: {resume} says how its map is made; leave the option out")
    return RatSlam.load(resume), load_run(resume)


def _interrupted(recorder: "RunRecorder", step: Step, watch: "Watch | None") -> bool:
    """Process the events until the end or Ctrl-C; tell whether it was interrupted.

    KeyboardInterrupt is raised again if nothing was done before.
    """
    from fusionslam.pipelines.maps import run_events

    try:
        run_events(recorder, step, watch)
    except KeyboardInterrupt:
        if not recorder.has_steps:
            raise
        return True
    return False


def _write(run: "RatSlamRun", slam: "RatSlam", output: Path, save: Path | None) -> None:
    from fusionslam.ratslam.map_export import export_run

    run.save(output / "run.npz")
    export_run(output, run)
    if save is not None:
        slam.save(save, run=run)


def _page(run: "RatSlamRun", output: Path, no_report: bool) -> Path:
    """Print how good the map is and write the page if wanted; return the file to look at."""
    from fusionslam.evaluation.maps.judge import judge_map

    judged = judge_map(run)
    judged.save(output / "map_report.json")
    print(judged)
    if no_report:
        return output / "map.json"
    from fusionslam.report.maps.page import write_ratslam_report

    return write_ratslam_report(output, run, judged, command=opt.command_line())
