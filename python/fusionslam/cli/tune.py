# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command tune: tuning of the scene similarity's parameters."""

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table, progress
from fusionslam.cli.failures import keep, needs_extra
from fusionslam.cli.recordings import build_recording, open_scenes
from fusionslam.cli.views.tables import HEADS, figures, without_sensor

if TYPE_CHECKING:
    from fusionslam.views.scene_set import SceneSet

logger = logging.getLogger(__name__)


@opt.options_of(views_config=partial(opt.views_config, source=None), open_scenes=open_scenes)
def tune(
    ctx: typer.Context,
    scenes: opt.SceneSets,
    output: Annotated[Path, typer.Option("--output", "-o", help="YAML for --config.")],
    *,
    views_config: Callable[[], Any],
    open_scenes: "Callable[..., SceneSet]",
    jobs: opt.Jobs = None,
) -> None:
    """Search for the parameters of the similarity that recognise places best.

    An interrupted call resumes where it stopped, with the same result.
    """
    from fusionslam.pipelines.tuning import TuningState, write_tuning
    from fusionslam.pipelines.tuning import tune as find

    needs_extra("tune")
    whole = views_config()
    state = output.with_name(f"{output.name}.state")
    for file in (output, state):
        opt.check_output(file, *scenes, views_config)
    keep(ctx, state)
    with progress() as step:
        sets = [open_scenes(build_recording(path), whole, step) for path in scenes]

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
    write_tuning(output, result, whole.tuning, sets, opt.command_line())
    rows: list[list[str]] = []
    for each, report in zip(sets, result.reports, strict=True):
        rows += [[each.name, *figures(report)], *without_sensor(each, report.rule_name)]
    print_table(["", *HEADS], rows)
    print(f"{output}: value {result.value:.4f}")
