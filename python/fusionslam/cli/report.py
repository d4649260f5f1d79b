# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command report: the pages for stored runs."""

from pathlib import Path
from typing import Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.failures import keep_parts, needs_extra


@opt.options_of()
def report(
    ctx: typer.Context,
    folder: opt.Results,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the report; by default OUT.")
    ] = None,
    protocol: opt.Protocol = None,
) -> None:
    """Write report.html for the runs in OUT, and views.html for runs of views.

    Frames are pictured if the recording is still there.
    """
    from fusionslam.pipelines.compare_descriptors import evaluate_stored
    from fusionslam.pipelines.describe import run_files
    from fusionslam.pipelines.results import load_verified, runs_folder
    from fusionslam.report import has_view_runs, write_stored_view_report
    from fusionslam.report.loops.stored import write_stored_report

    needs_extra("report")
    if has_view_runs(folder):
        keep_parts(ctx, output or folder)
        print(write_stored_view_report(folder, output))
        if not (run_files(runs_folder(folder)) or load_verified(folder)):
            return
    with progress() as step:
        changes = {} if protocol is None else {"protocol": protocol}
        evaluations, _ = evaluate_stored(folder, changes, step=step)
        keep_parts(ctx, output or folder)
        step("writing the report", 0, 1)
        page = write_stored_report(folder, evaluations, output=output, protocol=protocol)
        step("writing the report", 1, 1)
    print(page)
