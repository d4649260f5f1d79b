# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command eval: stored runs against ground truth."""

import logging

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_summary, progress

logger = logging.getLogger(__name__)


@opt.options_of()
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
