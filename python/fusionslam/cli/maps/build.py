# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command map build: a recording becomes a session of a map."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import OPENING, progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.recordings import build_recording, open_data
from fusionslam.errors import ConfigError
from fusionslam.help_texts import counted
from fusionslam.storage.files import is_map_file
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset
    from fusionslam.pipelines.place_maps import Built, MapOdometry
    from fusionslam.pipelines.recording import Recording
    from fusionslam.registration import Refusal
    from fusionslam.storage.progress import Step

ODOMETRY = ("recorded", "lidar", "truth+noise")
Odometry = Annotated[
    str,
    opt.one_of(
        "--odometry",
        names=ODOMETRY,
        help="The recording's, that of its scans (extra odometry), or true poses with errors "
        "(--set odometry.KEY).",
    ),
]


@opt.options_of(build_recording=build_recording, read_config=opt.read_config)
def build(
    ctx: typer.Context,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The map's file (.fsmap), made or gone on with.")
    ] = Path("out/site.fsmap"),
    session: Annotated[
        str | None,
        typer.Option("--session", metavar="NAME", help="Of the drive; by default the recording's."),
    ] = None,
    descriptor: Annotated[
        str | None,
        typer.Option(
            "--descriptor",
            "-d",
            metavar="NAME",
            help="Of a new map: by default cm2dp, or m2dp where clouds have no colours.",
        ),
    ] = None,
    odometry: Odometry = "recorded",
    source: opt.Source = None,
    trajectory: Annotated[
        Path | None,
        typer.Option("--trajectory", metavar="FILE", help="Also write each frame's pose (TUM)."),
    ] = None,
    *,
    build_recording: "Callable[[], Recording]",
    read_config: "Callable[[], Any]",
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
    no_report: opt.NoReport = False,
) -> None:
    """Add DATA to a map: keyframes, loops and poses.

    Each keyframe is on the disk at once: the same command goes on where an interrupted one ended.
    A map keeps the configuration that it was made with. A page beside it shows it.
    """
    needs_extra("map")
    if not no_report:
        needs_extra("report", unless="--no-report")
    from fusionslam.config import merged
    from fusionslam.datasets import write_poses_tum
    from fusionslam.descriptors import load_descriptor
    from fusionslam.mapping import PlaceMap
    from fusionslam.mapping.place_map import DEFAULT_DESCRIPTOR
    from fusionslam.pipelines.describe import describable
    from fusionslam.pipelines.place_maps import (
        build_map,
        check_odometry,
        frame_trajectory,
        odometry_of,
    )

    if output.suffix == ".html":
        raise ConfigError(
            f"--output is {output}: expected the map's file (.fsmap), beside which its page is "
            "written",
            code="choice",
            fields=("--output", str(output)),
        )
    if not is_map_file(output):
        opt.check_output(output, build_recording, read_config)
    if trajectory is not None:
        opt.check_output(trajectory, output, build_recording, read_config)
    kind = cast("MapOdometry", opt.check_choice("odometry", odometry, ODOMETRY))
    if descriptor is not None:
        load_descriptor(descriptor)
    whole = read_config()
    recording = build_recording()
    if source is not None:
        whole = merged(whole, {"fusion": {"source": source}})
    cores = opt.cores(jobs)
    keep(ctx, output)
    with progress() as step:
        step(OPENING, 0, 1)
        dataset, whole = open_data(recording, whole)
        step(OPENING, 1, 1)
        check_odometry(dataset, kind)
        name = session or Path(recording.path).stem
        given = whole.loop_closure.model_fields_set
        loops = merged(whole.loop_closure, {} if "window" in given else {"window": 20})
        if descriptor is None and not output.exists():
            usual = [DEFAULT_DESCRIPTOR]
            (descriptor,) = describable(dataset, usual, whole, "skip", replace=True)
        site = PlaceMap.open(
            output,
            name,
            descriptor=descriptor,
            loops=loops,
            describe=whole.descriptors,
            fusion=whole.fusion,
            registration=whole.registration,
            config=whole.mapping,
        )
        with site:
            site.check_recording(dataset.name)
            poses = odometry_of(
                dataset,
                kind,
                scanned=whole.lidar_odometry,
                errors=whole.odometry,
                jobs=cores,
                step=step,
            )
            built = build_map(
                site,
                dataset,
                poses,
                bad_frames=opt.bad_frames(skip_bad_frames),
                jobs=cores,
                progress=label_progress(step, "mapping"),
            )
            warning, window = site.reason, site.settings.loops.window
            if trajectory is not None:
                write_poses_tum(trajectory, *frame_trajectory(site, name, dataset, poses))
        page = None if no_report else output.with_suffix(".html")
        lines = finish_map(output, name, dataset, kind, page, step, warning)
    print(f"{name}: {describe_growth(built, window)}")
    for line in [*lines, *map(str, filter(None, (output, page, trajectory)))]:
        print(line)


def describe_growth(built: "Built", window: int) -> str:
    """Say what a map gained, and that no loops may be for the window (in keyframes) being long."""
    left = f", {counted(len(built.skipped), 'frame')} left out" if built.skipped else ""
    if not built.keyframes and not built.loops:
        return f"nothing new{left or ': the map has all of it'}"
    short = ""
    if not built.loops and 4 < built.keyframes <= 2 * window:
        short = (
            f"; keyframes are compared with those {window} and more before them: a map of its own "
            f"with --set loop_closure.window={built.keyframes // 4} has more to compare"
        )
    return f"{counted(built.keyframes, 'keyframe')}, {counted(built.loops, 'loop')}{left}{short}"


_MADE_ODOMETRY = "Odometry is made: true poses with errors (odometry.KEY of the configuration)."


def finish_map(
    path: Path,
    session: str,
    dataset: "Dataset",
    odometry: "MapOdometry",
    page: Path | None,
    step: "Step",
    warning: "Refusal | None" = None,
) -> list[str]:
    """Describe a map that was built, with its errors where the truth is known; write its page.

    Args:
        path: of the map.
        session: that was built.
        dataset: its recording.
        odometry: where it came from.
        page: path of the page; None for none.
        step: progress callback.
        warning: what is wrong with the map as a whole.

    Returns:
        Lines to print.

    Raises:
        DataError: the map cannot be read, or the page cannot be written.
    """
    from fusionslam.mapping import PlaceMap
    from fusionslam.pipelines.place_maps import true_keyframes
    from fusionslam.report.place_maps import read_drives, write_map_page

    with PlaceMap.open(path, read_only=True) as site:
        known = true_keyframes(site, session, dataset)
        truth = {} if known is None else {session: known}
        lines = [site.describe()]
        lines += [
            f"ATE of {drive.name}: {drive.error:.2f} m, of odometry alone "
            f"{drive.odometry_error:.2f} m"
            for drive in read_drives(site, truth)
            if drive.error is not None
        ]
        notes = [_MADE_ODOMETRY] if odometry == "truth+noise" else []
        if page is not None:
            step("drawing the map", 0, 1)
            why = [f"{warning}."] if warning else []
            write_map_page(page, site, truth, command=opt.command_line(), notes=[*notes, *why])
            step("drawing the map", 1, 1)
    return [*lines, *notes]
