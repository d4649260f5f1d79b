# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""DATA of commands as a recording; for a world, of a drive that is simulated first."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.base.progress import Step
from fusionslam.cli import options as opt

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording
    from fusionslam.views.scene_set import SceneSet

Data = Annotated[
    Path,
    typer.Argument(
        metavar="DATA",
        help="A recording (folder, bag, .npz), a world (.glb, .world, .sdf), or town, warehouse, "
        "house, hospital; its kind is recognised.",
    ),
]


def build_recording(
    data: Data,
    kind: Annotated[
        str | None,
        opt.one_of(
            "--kind", names=opt.KINDS, check=False, help="Kind of DATA; by default recognised."
        ),
    ] = None,
    sequence: Annotated[
        str | None, typer.Option(help="Sequence to take if DATA holds several.")
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WHAT=/NAME",
            help="Topic of a bag for points, left, camera_info, right, right_camera_info, "
            "odometry, truth, imu, fix, a further camera, or NAME_points for a further scanner; "
            "may be repeated.",
        ),
    ] = None,
    stamps: Annotated[
        str,
        opt.one_of(
            "--stamps",
            names=opt.STAMPS,
            help="Times of a bag's messages: of their headers, or of their arrival (bag).",
        ),
    ] = "header",
    sync: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="How a bag's images are paired with its scans: policy=last_before, "
            "max_difference=0.05, ...",
        ),
    ] = None,
    calib: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="calib.yaml for a bag or folder without one."),
    ] = None,
    no_deskew: Annotated[
        bool,
        typer.Option(
            "--no-deskew",
            help="Leave motion within a bag's scans as it is, which odometry and times of points "
            "undo: for clouds whose driver did.",
        ),
    ] = False,
    skip_gaps: Annotated[
        bool, typer.Option("--skip-gaps", help="Leave out frames that lack a file.")
    ] = False,
    gt: opt.Truth = None,
) -> "Recording":
    """Build the recording that the options name; of a simulated world it is made first."""
    from fusionslam.cli.data import parse_sync, parse_topics, record_if_world
    from fusionslam.pipelines.recording import Recording

    topics, changes = parse_topics(topic or []), parse_sync(sync or [])
    path, simulated = record_if_world(data, kind)
    return Recording.at(
        path,
        kind=kind,
        sequence=sequence,
        gaps="skip" if skip_gaps else "error",
        poses=gt,
        topics=topics,
        stamps=stamps,
        sync=changes,
        calibration=calib,
        deskew=not no_deskew,
        simulated=simulated,
    )


BuildRecording = Annotated[Callable[..., "Recording"], build_recording]
"""For a command: its recording, with the options that say how DATA is read."""


def open_scenes(
    recording: "Recording",
    whole: Any,
    step: Step,
    *,
    features: Sequence[str] = (),
    skip_empty: Annotated[
        bool, typer.Option("--skip-empty", help="Leave out scans without points above the floor.")
    ] = False,
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
) -> "SceneSet":
    """Return a stored scene set, or make one from a recording."""
    from fusionslam.cli.data import record_scenes_of

    bad_frames = opt.bad_frames(skip_bad_frames)
    scenes = record_scenes_of(recording, whole, step, features, opt.cores(jobs), bad_frames)
    return scenes.without_empty() if skip_empty else scenes


OpenScenes = Annotated[Callable[..., "SceneSet"], open_scenes]
"""For a command: the scenes of its recording, with the options that say which."""
