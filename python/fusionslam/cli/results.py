# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands eval and report: stored runs against ground truth, and pages of them."""

import logging
from pathlib import Path
from typing import Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import during, progress
from fusionslam.cli.failures import WRITES_ALL, keep, needs_extra

logger = logging.getLogger(__name__)


@opt.command
def evaluate(
    folder: opt.Results,
    gt: opt.Truth = None,
    protocol: opt.Protocol = None,
    radius: opt.Radius = None,
    window: opt.Window = None,
    settings: opt.Settings = None,
) -> None:
    """Judge the runs in OUT against true poses; write metrics.json there.

    Where nothing can be judged, a metrics.json that is there is kept.

    --set takes keys of the section evaluation.
    """
    from fusionslam.cli.summary import print_summary
    from fusionslam.config import Section, with_settings
    from fusionslam.evaluation import EvaluationConfig
    from fusionslam.pipelines.compare_descriptors import evaluate_stored
    from fusionslam.report.loops.stored import write_stored_metrics

    class _Stages(Section):
        """The only section that can still be changed."""

        evaluation: EvaluationConfig = EvaluationConfig()

    given = {"protocol": protocol, "radius": radius, "window": window}
    changes = with_settings(_Stages(), settings or []).evaluation.model_dump(exclude_unset=True)
    changes |= {key: value for key, value in given.items() if value is not None}
    with progress() as step:
        evaluations, config = evaluate_stored(folder, changes, gt, step)
    print_summary(evaluations, config.protocol)
    path = folder / "metrics.json"
    judged = any(curve.n_revisits for each in evaluations for curve in each.curves.values())
    if judged or not path.exists():
        command, judging = opt.command_line(), config.protocol
        print(write_stored_metrics(folder, evaluations, command=command, protocol=judging))
    else:
        logger.warning("nothing could be judged: %s is kept as it was", path)


@opt.command
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
    from fusionslam.pipelines.results import load_verified, run_files, runs_folder
    from fusionslam.report import has_view_runs, write_stored_view_report
    from fusionslam.report.loops.stored import write_stored_report

    needs_extra("report")
    if has_view_runs(folder):
        keep(ctx, output or folder, WRITES_ALL)
        print(write_stored_view_report(folder, output))
        if not (run_files(runs_folder(folder)) or load_verified(folder)):
            return
    with progress() as step:
        changes = {} if protocol is None else {"protocol": protocol}
        evaluations, _ = evaluate_stored(folder, changes, step=step)
        keep(ctx, output or folder, WRITES_ALL)
        with during(step, "writing the report"):
            page = write_stored_report(folder, evaluations, output=output, protocol=protocol)
    print(page)
