# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command ratslam: maps of recordings."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import urlsplit

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import OPENING, progress
from fusionslam.cli.failures import INTERRUPTED, needs_extra
from fusionslam.cli.recordings import build_recording
from fusionslam.storage.files import delay_interrupts, make_folder
from fusionslam.storage.progress import Step

if TYPE_CHECKING:
    from fusionslam.evaluation.maps.run import RatSlamRun
    from fusionslam.pipelines.map_events import RunEvents
    from fusionslam.pipelines.maps import Recovery, RunRecorder, Watch
    from fusionslam.pipelines.recording import Recording
    from fusionslam.ratslam.slam import RatSlam

_OF_THE_STATE = (
    "--views",
    "--source",
    "ratslam.",
    "views.",
    "visual_templates.",
    "fusion.",
    "descriptors.",
)


@opt.options_of(build_recording=build_recording)
def ratslam(
    output: opt.Folder = Path("out/ratslam"),
    views: Annotated[
        str | None,
        opt.one_of(
            "--views",
            names=opt.RECOGNISERS,
            check=False,
            help="Recogniser of places; by default alignment.",
        ),
    ] = None,
    odometry: Annotated[
        str | None,
        opt.one_of(
            "--odometry",
            names=opt.ODOMETRY,
            help="Source of motion; by default the topic if there is one, else the truth.",
        ),
    ] = None,
    source: opt.Source = None,
    preset: Annotated[
        str | None,
        opt.one_of(
            "--preset",
            names=opt.PRESETS_OF_RATSLAM,
            check=False,
            help="Of the map; by default robust (ours).",
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, help="Seed of the noise of --odometry truth+noise."),
    ] = None,
    save: Annotated[
        Path | None,
        typer.Option("--save", metavar="STATE", help="Write a state file for --resume."),
    ] = None,
    rule: opt.Rule = "paper",
    resume: Annotated[
        Path | None,
        typer.Option("--resume", metavar="STATE", help="Resume with the map that --save wrote."),
    ] = None,
    live: Annotated[
        str | None,
        typer.Option(
            "--live",
            metavar="WHERE",
            help="Show the growing map: viewer opens rerun, FILE.rrd is a file for it, foxglove "
            "or ws://HOST:PORT serves Foxglove.",
        ),
    ] = None,
    *,
    build_recording: "Callable[[], Recording]",
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    no_report: opt.NoReport = False,
) -> None:
    """Build a map of a robot's path from its odometry and the places that it recognises.

    Ctrl-C keeps the map so far, and the state to resume from.
    """
    from fusionslam.pipelines.drives import open_drive
    from fusionslam.pipelines.map_events import events_of, expected_drift
    from fusionslam.pipelines.maps import RunRecorder
    from fusionslam.pipelines.results import refuse_input, refuse_other_data
    from fusionslam.sim.rendered_images import rendered_images
    from fusionslam.views.recognisers import find_recogniser

    if not no_report:
        needs_extra("report", unless="--no-report")
    address = None if live is None else _foxglove_address(live)
    if live is not None:
        needs_extra("live", module="foxglove" if address else "rerun")
    for file in (save, None if address or live in (None, "viewer") else Path(str(live))):
        if file is not None:
            opt.check_output(file, build_recording, config)
    changes = [*([f"ratslam.preset={preset}"] if preset else []), *(settings or [])]
    changes += [f"odometry.seed={seed}"] if seed is not None else []
    if views is not None:
        find_recogniser(views, "--views")
    drift = expected_drift(odometry)
    first = {
        "recording": {"shapes": "collision"},
        "ratslam": {"map": drift},
        "views": {"places": drift},
    }
    whole = opt.views_config(source, None, changes, config, **first)
    slam, earlier = None, None
    if resume is not None:
        given = {"--views": views, "--source": source}
        options = [option for option, value in given.items() if value is not None]
        slam, earlier = _load_map(resume, [*options, *changes])
    with make_folder(output), ExitStack() as shown:
        recording = build_recording()
        refuse_input(recording, output)
        slam = slam or _new_map(whole, views, recording)
        with progress() as step:
            step(OPENING, 0, 1)
            drive = open_drive(
                recording,
                ranges=whole.recording,
                render=rendered_images,
                jobs=opt.cores(jobs),
                step=step,
            )
            step(OPENING, 1, 1)
            if resume is None:
                refuse_other_data(output, recording, drive.name)
            assert slam.views is not None  # holds for every named source
            events = events_of(
                drive,
                slam.views,
                odometry,
                whole.odometry,
                seen=whole.visual_odometry,
                scanned=whole.lidar_odometry,
                resumed=resume is not None,
                continued=save is not None,
                jobs=opt.cores(jobs),
                progress=step,
            )
            recorder = RunRecorder(slam, events, earlier=earlier)
            watch = shown.enter_context(_live(live, address, events))
            interrupted = _process_events(recorder, step, watch)
        # Before the live view is closed, so that the map is kept even if its file fails.
        _finish(recorder, output, save, rule, interrupted=interrupted, no_report=no_report)


def _finish(
    recorder: "RunRecorder",
    output: Path,
    save: Path | None,
    rule: str,
    *,
    interrupted: bool,
    no_report: bool,
) -> None:
    """Write everything and say where; for an interrupted run also how to resume."""
    from fusionslam.ratslam.map_export import export_run

    run = recorder.record()
    if interrupted:
        save = save or output / "state.npz"
    try:
        with delay_interrupts():
            if save is not None:
                recorder.slam.save(save, run=run)
            run.save(output / "run.npz")
            export_run(output, run)
        print(_page(run, recorder.recoveries, output, rule, no_report or interrupted))
    except KeyboardInterrupt:
        also = "" if save is None else f", its state {save}"
        typer.echo(f"interrupted: {output} holds the map{also}, but no judgement of it", err=True)
        raise typer.Exit(INTERRUPTED) from None
    if interrupted:
        typer.echo(f"interrupted: resume with --resume {save}", err=True)
        raise typer.Exit(INTERRUPTED)


def _foxglove_address(live: str) -> tuple[str, int] | None:
    """Return host and port of --live for Foxglove; None if it is for rerun. Raises ConfigError."""
    if live == "foxglove":
        from fusionslam.report.live import HOST, PORT

        return HOST, PORT
    if not live.startswith("ws:"):
        return None
    from fusionslam.errors import ConfigError

    url = urlsplit(live)
    with suppress(ValueError):  # of a port that is no number up to 65535
        if url.hostname and url.port is not None and live == f"ws://{url.netloc}":
            return url.hostname, url.port
    raise ConfigError(
        f"--live {live}: expected ws://HOST:PORT, such as ws://127.0.0.1:8766",
        code="no-address",
        fields=(live,),
    )


@contextmanager
def _live(
    live: str | None, address: tuple[str, int] | None, events: "RunEvents"
) -> "Iterator[Watch | None]":
    """Yield the function that shows each step live; None without --live."""
    if live is None:
        yield None
        return
    if address is None:
        from fusionslam.report.live.rerun_view import RerunView

        path = None if live == "viewer" else live
        with RerunView(path, events.name, events.truth) as view:
            yield view.step
        return
    from fusionslam.report.live.foxglove_view import FoxgloveView

    with FoxgloveView(*address, name=events.name, truth=events.truth) as served:
        typer.echo(f"live view: open {served.url} in Foxglove", err=True)
        yield served.step


def _load_map(state: Path, options: list[str]) -> "tuple[RatSlam, RatSlamRun | None]":
    """Return a stored map and its run.

    Raises:
        ConfigError: options that the map decides. DataError: the file is no state, or its views
            come from another process.
    """
    from fusionslam.errors import ConfigError, DataError
    from fusionslam.ratslam.external_views import GivenViews
    from fusionslam.ratslam.slam import RatSlam, load_run

    for text in options:
        if text.startswith(_OF_THE_STATE):
            raise ConfigError(
                f"{text}: {state} already decides this; leave the option out",
                code="set-by-state",
                fields=(text,),
            )
    _check_state(state)
    slam = RatSlam.load(state)
    if slam.views is None or isinstance(slam.views, GivenViews):
        raise DataError(
            f"--resume {state}: its views were recognised by another process (a ROS node, or a "
            "program of yours) and are not in the file: continue it there (map_file:=, "
            "RatSlam.load), or build a map of all recordings with --save",
            code="given-views",
            fields=(str(state),),
        )
    return slam, load_run(state)


def _check_state(state: Path) -> None:
    """Raise DataError for a recording or a stored result of another command."""
    from fusionslam.datasets.kinds import KINDS
    from fusionslam.errors import DataError
    from fusionslam.ratslam.slam import FORMAT
    from fusionslam.storage.archive import format_of
    from fusionslam.storage.files import is_map_file

    if is_map_file(state):
        raise DataError(
            f"--resume {state}: it is a map of map build (fusionslam map show says what is in it), "
            "expected the file that ratslam --save (or Ctrl-C) wrote",
            code="no-state",
            fields=(str(state), "map"),
        )
    found = format_of(state)
    kinds = (kind for kind in KINDS.values() if state.is_dir() or not kind.folder)
    kind = next((kind.name for kind in kinds if state.exists() and kind.recognises(state)), None)
    if kind is None and found in (None, FORMAT):
        return  # what cannot be read at all is refused by RatSlam.load
    what = f"of format {found}" if kind is None else f"a recording ({kind})"
    raise DataError(
        f"--resume {state}: it is {what}, expected the file that ratslam --save (or Ctrl-C) wrote; "
        "a recording is given as DATA",
        code="no-state",
        fields=(str(state), kind or str(found)),
    )


def _new_map(whole: Any, views: str | None, recording: "Recording") -> "RatSlam":
    from fusionslam.config import merged
    from fusionslam.errors import DataError
    from fusionslam.pipelines.recording import has_colors, settle_frame
    from fusionslam.ratslam.slam import RatSlam
    from fusionslam.ratslam.view_sources import SourceOptions, build_view_source
    from fusionslam.views.recognisers import method_of, settle_method

    # A recording of images alone has no clouds; views that need them fail later.
    with suppress(DataError):
        whole = merged(whole, {"fusion": {"source": opt.choose_source(None, whole, recording)}})
        dataset = recording.open(whole.fusion.source)
        update: dict[str, Any] = {"fusion": settle_frame(whole.fusion, dataset)}
        if views is None:
            colored = has_colors(dataset, whole.fusion.source)
            update["views"] = settle_method(whole.views, colored=colored, name=dataset.name)
        whole = whole.model_copy(update=update)
    options = SourceOptions(whole.views, whole.fusion, whole.descriptors, whole.visual_templates)
    name = views or method_of(whole.views)
    return RatSlam(whole.ratslam, views=build_view_source(name, options))


def _process_events(recorder: "RunRecorder", step: Step, watch: "Watch | None") -> bool:
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


def _page(
    run: "RatSlamRun", recoveries: "list[Recovery]", output: Path, rule: str, no_report: bool
) -> Path:
    """Print how good the map is and write the page if wanted; return the file to look at."""
    from fusionslam.evaluation.maps.judge import judge_map
    from fusionslam.pipelines.results import delete_page

    judged = judge_map(run, rule=rule)
    judged.save(output / "map_report.json")
    print(judged)
    for each in recoveries:
        print(each)
    if no_report:
        delete_page(output, "ratslam")
        return output / "map.json"
    from fusionslam.report.maps.page import write_ratslam_report

    return write_ratslam_report(output, run, judged, command=opt.command_line())
