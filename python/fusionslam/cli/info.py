# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command info: what is in a recording."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table, progress
from fusionslam.cli.recordings import build_recording
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording


@opt.options_of(build_recording=partial(build_recording, skip_gaps=True))
def info(
    build_recording: "Callable[[], Recording]",
    every: Annotated[
        bool, typer.Option("--all", help="Read all frames, and name those that cannot be read.")
    ] = False,
    jobs: opt.Jobs = None,
) -> None:
    """Summarise DATA: frames, sensors, calibration, poses, gaps; say what stored results are."""
    from fusionslam.pipelines.frame_check import check_frames
    from fusionslam.pipelines.overview import look_at

    recording = build_recording()
    with progress() as step:
        show = label_progress(step, "reading")
        check = partial(check_frames, jobs=opt.cores(jobs), progress=show) if every else None
        found = look_at(recording, check)
    print_table(["what", "value"], found.rows)
