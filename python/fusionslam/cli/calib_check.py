# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command calib-check: whether LiDAR and camera fit together."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table, progress
from fusionslam.cli.failures import keep_parts, needs_extra
from fusionslam.cli.recordings import build_recording
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording


@opt.options_of(build_recording=build_recording, read_config=opt.read_config)
def calib_check(
    ctx: typer.Context,
    output: opt.Folder = Path("out/calib-check"),
    pictures: Annotated[
        int, typer.Option("--pictures", min=0, help="Number of frames to draw.")
    ] = 3,
    *,
    build_recording: "Callable[[], Recording]",
    read_config: "Callable[[], Any]",
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
    keep_parts(ctx, output)
    with progress() as step:
        show = label_progress(step, "finding edges")
        check = check_calibration(dataset, chosen, show, jobs=opt.cores(jobs))
    check.save(output / "calib_check.json")
    paths = write_overlays(dataset, frames_of(dataset, pictures), output)
    print_table(["what", "best", "not surely worse", "score"], check.rows())
    print(f"{len(check.frames)} frames, {check.points} depth edges: {check.verdict}")
    for path in (*paths, output / "calib_check.json"):
        print(path)
