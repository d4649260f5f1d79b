# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command eval: stored runs against ground truth."""

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_summary, progress


@opt.options_of()
def evaluate(
    folder: opt.Results,
    gt: opt.Truth = None,
    protocol: opt.Protocol = None,
    radius: opt.Radius = None,
    window: opt.Window = None,
) -> None:
    """Judge the runs in OUT against true poses; write metrics.json there."""
    from fusionslam.pipelines.compare_descriptors import evaluate_stored
    from fusionslam.report.loops.stored import write_stored_metrics

    given = {"protocol": protocol, "radius": radius, "window": window}
    changes = {key: value for key, value in given.items() if value is not None}
    with progress() as step:
        evaluations, config = evaluate_stored(folder, changes, gt, step)
    path = write_stored_metrics(folder, evaluations, command=opt.command_line())
    print_summary(evaluations, config.protocol)
    print(path)
