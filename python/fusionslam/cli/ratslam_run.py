# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""What the command ratslam does around a run: state, live view, interrupt, files, page."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import typer

from fusionslam.base.archive import format_of
from fusionslam.base.files import delay_interrupts, is_map_file
from fusionslam.base.progress import Step
from fusionslam.cli import options as opt
from fusionslam.cli.failures import INTERRUPTED
from fusionslam.config import merged
from fusionslam.datasets.kinds import KINDS
from fusionslam.errors import ConfigError, DataError
from fusionslam.evaluation.maps.judge import judge_map
from fusionslam.evaluation.maps.run import RatSlamRun
from fusionslam.pipelines.map_events import RunEvents
from fusionslam.pipelines.maps import Recovery, RunRecorder, Watch, run_events
from fusionslam.pipelines.recording import Recording, has_colors, settle_frame
from fusionslam.pipelines.results import delete_page
from fusionslam.ratslam.external_views import GivenViews
from fusionslam.ratslam.map_export import export_run
from fusionslam.ratslam.slam import FORMAT, RatSlam, load_run
from fusionslam.ratslam.view_sources import SourceOptions, build_view_source
from fusionslam.report.live import HOST, PORT
from fusionslam.views.recognisers import method_of, settle_method

_OF_THE_STATE = (
    "--views",
    "--source",
    "ratslam.",
    "views.",
    "visual_templates.",
    "fusion.",
    "descriptors.",
)


def finish(
    recorder: RunRecorder,
    output: Path,
    save: Path | None,
    rule: str,
    *,
    interrupted: bool,
    no_report: bool,
) -> None:
    """Write everything and say where; for an interrupted run also how to resume."""
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


def foxglove_address(live: str) -> tuple[str, int] | None:
    """Return host and port of --live for Foxglove; None if it is for rerun. Raises ConfigError."""
    if live == "foxglove":
        return HOST, PORT
    if not live.startswith("ws:"):
        return None
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
def live_view(
    live: str | None, address: tuple[str, int] | None, events: RunEvents
) -> Iterator[Watch | None]:
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


def load_map(state: Path, options: list[str]) -> tuple[RatSlam, RatSlamRun | None]:
    """Return a stored map and its run.

    Raises:
        ConfigError: options that the map decides. DataError: the file is no state, or its views
            come from another process.
    """
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


def new_map(whole: Any, views: str | None, recording: Recording) -> RatSlam:
    """Return an empty map with the views that options and recording ask for."""
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


def process_events(recorder: RunRecorder, step: Step, watch: Watch | None) -> bool:
    """Process the events until the end or Ctrl-C; tell whether it was interrupted.

    KeyboardInterrupt is raised again if nothing was done before.
    """
    try:
        run_events(recorder, step, watch)
    except KeyboardInterrupt:
        if not recorder.has_steps:
            raise
        return True
    return False


def _page(
    run: RatSlamRun, recoveries: list[Recovery], output: Path, rule: str, no_report: bool
) -> Path:
    """Print how good the map is and write the page if wanted; return the file to look at."""
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
