# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command map build: a recording becomes a session of a map."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import OPENING, progress
from fusionslam.cli.failures import needs_extra
from fusionslam.cli.recordings import build_recording, open_data
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.pipelines.place_maps import MapOdometry
    from fusionslam.pipelines.recording import Recording

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
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The map's file (.fsmap), made or gone on with.")
    ] = Path("out/site.fsmap"),
    session: Annotated[
        str | None,
        typer.Option("--session", metavar="NAME", help="Of the drive; by default the recording's."),
    ] = None,
    descriptor: Annotated[
        str, typer.Option("--descriptor", "-d", metavar="NAME", help="Of a new map.")
    ] = "cm2dp",
    odometry: Odometry = "recorded",
    source: opt.Source = None,
    *,
    build_recording: "Callable[[], Recording]",
    read_config: "Callable[[], Any]",
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
) -> None:
    """Add DATA to a map: keyframes, loops and poses.

    Each keyframe is on the disk at once: the same command goes on where an interrupted one ended.
    A map keeps the configuration that it was made with.
    """
    needs_extra("map")
    from fusionslam.config import merged
    from fusionslam.mapping import PlaceMap
    from fusionslam.pipelines.place_maps import build_map, odometry_of

    kind = cast("MapOdometry", opt.check_choice("odometry", odometry, ODOMETRY))
    whole = read_config()
    recording = build_recording()
    if source is not None:
        whole = merged(whole, {"fusion": {"source": source}})
    cores = opt.cores(jobs)
    with progress() as step:
        step(OPENING, 0, 1)
        dataset, whole = open_data(recording, whole)
        step(OPENING, 1, 1)
        name = session or Path(recording.path).stem
        given = whole.loop_closure.model_fields_set
        loops = merged(whole.loop_closure, {} if "window" in given else {"window": 20})
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
            text = site.describe()
    if not built.frames:
        print(f"{name}: the map has all of it")
    else:
        left = f", {len(built.skipped)} frames left out" if built.skipped else ""
        print(f"{name}: {built.keyframes} keyframes, {built.loops} loops{left}")
    print(text)
    print(output)
