# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands fuse, odometry, calib-check and calibrate: clouds, path, calibration."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.base.progress import label_progress
from fusionslam.base.texts import counted
from fusionslam.cli import options as opt
from fusionslam.cli.console import during, print_table, progress
from fusionslam.cli.failures import PARTIAL, WRITES_ALL, keep, needs_extra
from fusionslam.cli.recordings import BuildRecording

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording

logger = logging.getLogger(__name__)


@opt.command
def fuse(
    ctx: typer.Context,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for the clouds, or a bag: .bag, .db3, .mcap."),
    ] = Path("out/fuse"),
    source: opt.Source = None,
    format: Annotated[
        str | None,
        opt.one_of(
            "--format",
            names=opt.FORMATS,
            check=False,
            help="Of clouds in a folder, by default ply; bin has no colours.",
        ),
    ] = None,
    *,
    build_recording: BuildRecording,
    pictures: Annotated[
        int, typer.Option("--pictures", metavar="N", min=0, help="Draw the steps of N frames.")
    ] = 0,
    pipeline_config: opt.PipelineConfigOf,
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
) -> None:
    """Write DATA's coloured clouds as a folder or bag to open again.

    Times, and poses if known, are written beside them; pictures of the steps go to pictures/ in
    the folder, or beside the bag.
    """
    from fusionslam.errors import ConfigError
    from fusionslam.pipelines.describe import for_source
    from fusionslam.pipelines.export_bag import BAG_SUFFIXES, write_cloud_bag
    from fusionslam.pipelines.export_folder import write_clouds

    chosen = pipeline_config()
    asked_for = source is not None or "source" in chosen.fusion.model_fields_set
    is_bag = output.suffix.lower() in BAG_SUFFIXES
    if is_bag:
        if format is not None:
            raise ConfigError(f"--format {format} is for folders of clouds, {output} is a bag")
        needs_extra("bags")
    elif format is None:
        opt.check_folder_name(output, BAG_SUFFIXES, "--format ply")
    if pictures:
        needs_extra("report", module="matplotlib")
    recording, bad_frames = build_recording(), opt.bad_frames(skip_bad_frames)
    chosen = for_source(chosen, opt.choose_source(source, chosen, recording))
    if chosen.fusion.source == "cloud" and not asked_for:
        _warn_of_missing_colors(recording)
    with progress() as step:
        show = label_progress(step, "fusing")
        if is_bag:
            keep(ctx, output, PARTIAL)
            count = write_cloud_bag(
                recording,
                output,
                chosen.fusion,
                jobs=opt.cores(jobs),
                bad_frames=bad_frames,
                progress=show,
            )
        else:
            keep(ctx, output)
            count = write_clouds(
                recording,
                output,
                chosen.fusion,
                format=format or "ply",
                jobs=opt.cores(jobs),
                bad_frames=bad_frames,
                command=opt.command_line(),
                progress=show,
            )
        if pictures:
            from fusionslam.report.fusion_stages import write_stages

            folder = output.with_suffix(".pictures") if is_bag else output / "pictures"
            dataset = recording.open(chosen.fusion.source)
            show = label_progress(step, "drawing")
            write_stages(dataset, folder, chosen.fusion, pictures, show)
    print(f"{output}: {counted(count, 'frame')}")


def _warn_of_missing_colors(recording: "Recording") -> None:
    """Warn that clouds stay without colours unless the user chose that."""
    from contextlib import suppress

    from fusionslam.errors import DataError

    # Errors in a frame are reported when it is fused.
    with suppress(DataError):
        if recording.open("cloud")[0].colors is None:
            logger.warning(
                "%s has no images with a calibration (CameraInfo): clouds have no colours "
                "(source cloud)",
                recording.path,
            )


@opt.command
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
    build_recording: BuildRecording,
    read_config: opt.ReadConfig,
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
) -> None:
    """Estimate the path of DATA from its scans, by KISS-ICP, or RKO-LIO where it has an IMU.

    Poses that cannot be right are refused with the reason, and then nothing is written.
    """
    chosen = read_config().lidar_odometry
    if chosen.imu == "always":
        needs_extra("inertial")
    else:
        needs_extra("odometry", unless="--set lidar_odometry.imu=always")
    from fusionslam.pipelines.frame_check import readable_frames
    from fusionslam.pipelines.lidar_odometry import (
        check_new_file,
        pose_format_of,
        track_lidar,
    )

    opt.check_output(output, build_recording, read_config)
    check_new_file(output)
    bad_frames, cores = opt.bad_frames(skip_bad_frames), opt.cores(jobs)
    with progress() as step:
        with during(step):
            # It undoes the motion within scans itself, by the one that it finds.
            recording = replace(build_recording(), deskew=False)
            dataset = readable_frames(recording.open("cloud"), bad_frames, jobs=cores)
        show = label_progress(step, "registering scans")
        track = track_lidar(dataset, chosen, jobs=cores, progress=show)
    track.save(output, format or pose_format_of(output))
    print(f"{output}: {track}")
    if dataset.true_poses is not None:
        drift = track.drift(dataset.true_poses)
        print(f"off the true poses by {drift.end:.2f} m at the end, at most {drift.largest:.2f} m")


@opt.command
def calib_check(
    ctx: typer.Context,
    output: opt.Folder = Path("out/calib-check"),
    pictures: Annotated[
        int, typer.Option("--pictures", min=0, help="Number of frames to draw.")
    ] = 3,
    *,
    build_recording: BuildRecording,
    read_config: opt.ReadConfig,
    jobs: opt.Jobs = None,
) -> None:
    """Check that scans and images of DATA fit together.

    Tries small turns, shifts and delays of the camera, and draws scans over their images.
    """
    from fusionslam.calibration.check import check_calibration, frames_of, write_overlays
    from fusionslam.datasets.streams import MissingSensorError

    if pictures:
        needs_extra("report", module="matplotlib", unless="--pictures 0")
    chosen = read_config().calib_check
    try:
        dataset = build_recording().open("lidar")
    except MissingSensorError as error:
        message = f"calib-check needs scans and left images: {error}"
        raise MissingSensorError(message, fields=error.fields) from error
    keep(ctx, output, WRITES_ALL)
    with progress() as step:
        show = label_progress(step, "finding edges")
        check = check_calibration(dataset, chosen, show, jobs=opt.cores(jobs))
    check.save(output / "calib_check.json")
    paths = write_overlays(dataset, frames_of(dataset, pictures), output)
    print_table(["what", "best", "not surely worse", "score"], check.rows())
    print(f"{len(check.frames)} frames, {check.points} depth edges: {check.verdict}")
    for path in (*paths, output / "calib_check.json"):
        print(path)


@opt.command
def calibrate(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="File for the result, JSON.")
    ] = Path("out/calibration.json"),
    *,
    build_recording: BuildRecording,
    read_config: opt.ReadConfig,
) -> None:
    """Estimate where the IMU of DATA is, and how late its stamps are.

    Both by the LiDAR's own path, with 95 % intervals, or the motion that is missing.
    """
    needs_extra("odometry")
    from fusionslam.pipelines.sensor_calibration import calibrate as estimate

    opt.check_output(output, build_recording, read_config)
    with progress() as step:
        with during(step):
            dataset = replace(build_recording(), deskew=False).open("cloud")
        found = estimate(dataset, label_progress(step, "registering scans"))
    print_table(["quantity", "now", "found", ""], [each.row() for each in found.estimates])
    for line in found.transform_lines():
        print(line)
    output.parent.mkdir(parents=True, exist_ok=True)
    found.save(output)
    print(output)
