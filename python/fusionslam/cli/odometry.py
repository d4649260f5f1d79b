# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command odometry: the path of a recording from its scans."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import OPENING, progress
from fusionslam.cli.failures import needs_extra
from fusionslam.cli.recordings import build_recording
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording


@opt.options_of(build_recording=build_recording, read_config=opt.read_config)
def odometry(
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="File for the poses, which must not exist."),
    ] = Path("out/odometry.txt"),
    format: Annotated[
        str | None,
        opt.one_of(
            "--format",
            names=opt.POSE_FORMATS,
            help="Of the file; by default tum, and kitti for X.kitti and X_kitti.txt.",
        ),
    ] = None,
    *,
    build_recording: "Callable[[], Recording]",
    read_config: "Callable[[], Any]",
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
) -> None:
    """Estimate the path of DATA from its scans, by KISS-ICP.

    Poses that cannot be right are refused with the reason, and then nothing is written.
    """
    needs_extra("odometry")
    from fusionslam.pipelines.frame_check import readable_frames
    from fusionslam.pipelines.lidar_odometry import (
        check_new_file,
        pose_format_of,
        track_lidar,
    )

    opt.check_output(output, build_recording, read_config)
    check_new_file(output)
    chosen = read_config().lidar_odometry
    bad_frames, cores = opt.bad_frames(skip_bad_frames), opt.cores(jobs)
    with progress() as step:
        step(OPENING, 0, 1)
        dataset = readable_frames(build_recording().open("cloud"), bad_frames, jobs=cores)
        step(OPENING, 1, 1)
        show = label_progress(step, "registering scans")
        track = track_lidar(dataset, chosen, jobs=cores, progress=show)
    track.save(output, format or pose_format_of(output))
    print(f"{output}: {track}")
    if dataset.true_poses is not None:
        drift = track.drift(dataset.true_poses)
        print(f"off the true poses by {drift.end:.2f} m at the end, at most {drift.largest:.2f} m")
