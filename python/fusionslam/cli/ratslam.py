# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command ratslam: maps of recordings."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from fusionslam.base.files import make_folder
from fusionslam.cli import options as opt
from fusionslam.cli.console import during, progress
from fusionslam.cli.failures import needs_extra
from fusionslam.cli.recordings import BuildRecording


@opt.command
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
    build_recording: BuildRecording,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    no_report: opt.NoReport = False,
) -> None:
    """Build a map of a robot's path from its odometry and the places that it recognises.

    Ctrl-C keeps the map so far, and the state to resume from.
    """
    from fusionslam.cli.ratslam_run import (
        finish,
        foxglove_address,
        live_view,
        load_map,
        new_map,
        process_events,
    )
    from fusionslam.pipelines.drives import open_drive
    from fusionslam.pipelines.map_events import events_of, expected_drift
    from fusionslam.pipelines.maps import RunRecorder
    from fusionslam.pipelines.results import refuse_input, refuse_other_data
    from fusionslam.sim.rendered_images import rendered_images
    from fusionslam.views.recognisers import find_recogniser

    if not no_report:
        needs_extra("report", unless="--no-report")
    address = None if live is None else foxglove_address(live)
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
        slam, earlier = load_map(resume, [*options, *changes])
    with make_folder(output), ExitStack() as shown:
        recording = build_recording()
        refuse_input(recording, output)
        slam = slam or new_map(whole, views, recording)
        with progress() as step:
            with during(step):
                drive = open_drive(
                    recording,
                    ranges=whole.recording,
                    render=rendered_images,
                    jobs=opt.cores(jobs),
                    step=step,
                )
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
            watch = shown.enter_context(live_view(live, address, events))
            interrupted = process_events(recorder, step, watch)
        # Before the live view is closed, so that the map is kept even if its file fails.
        finish(recorder, output, save, rule, interrupted=interrupted, no_report=no_report)
