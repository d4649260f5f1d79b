# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command tune: tuning of the scene similarity's parameters."""

import logging
from pathlib import Path
from typing import Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table, progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.views import options as view
from fusionslam.cli.views.tables import HEADS, figures, without_sensor

logger = logging.getLogger(__name__)


def tune(
    ctx: typer.Context,
    scenes: view.SceneSets,
    output: Annotated[Path, typer.Option("--output", "-o", help="YAML for --config.")],
    skip_empty: view.SkipEmpty = False,
    tuned: view.Tuned = None,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Look for the parameters of the similarity that judge recorded drives best.

    A call that was interrupted goes on where it stopped, and comes to the same end.
    """
    from fusionslam.pipelines.tuning import tune as find
    from fusionslam.pipelines.tuning import write_tuned
    from fusionslam.pipelines.tuning_state import TuningState

    needs_extra("tune")
    whole = view.build_config(tuned, config, settings)
    state = output.with_name(f"{output.name}.state")
    keep(ctx, state)
    with progress() as step:
        sets = [view.open_scenes(opt.build_recording(path), whole, step) for path in scenes]
        sets = [each.without_empty() for each in sets] if skip_empty else sets

        def show(done: int, total: int, best: float) -> None:
            step(f"tuning, best {best:.4f}", done, total)
            logger.info("generation %d of %d: best %.6f", done, total, best)

        result = find(
            sets,
            whole.views,
            whole.tuning,
            state=TuningState(state),
            jobs=opt.cores(jobs),
            progress=show,
        )
    write_tuned(output, result, whole.tuning, sets, opt.command_line())
    rows: list[list[str]] = []
    for each, report in zip(sets, result.reports, strict=True):
        rows += [[each.name, *figures(report)], *without_sensor(each, report.rule_name)]
    print_table(["", *HEADS], rows)
    print(f"{output}: value {result.value:.4f}")
