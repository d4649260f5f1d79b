# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command views curve: ids judged at many thresholds."""

from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table, progress
from fusionslam.cli.views import options as view
from fusionslam.cli.views.tables import HEADS, curve_row, without_sensor
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording


@opt.reading_options()
def curve(
    *,
    output: view.Folder,
    skip_empty: view.SkipEmpty = False,
    rule: view.Rule = "paper",
    loop_precision: Annotated[
        float, typer.Option("--loop-precision", min=0, max=1, help="Demanded of a threshold.")
    ] = 0.97,
    recording: "Recording",
    tuned: view.Tuned = None,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Judge the ids at many thresholds, and name the best ones."""
    from fusionslam.pipelines.views import sweep_thresholds

    whole = view.build_config(tuned, config, settings)
    opt.one_of("--rule", rule, ("paper", "author"))
    with progress() as step:
        scenes = view.open_scenes(recording, whole, step, jobs=opt.cores(jobs))
        scenes = scenes.without_empty() if skip_empty else scenes
        found = sweep_thresholds(
            scenes,
            whole.views,
            descriptors=whole.descriptors,
            rule=rule,
            progress=label_progress(step, "matching"),
        )
    found.save(output / "curve.json")
    best = {
        "most accurate": found.most_accurate_threshold(),
        f"loop precision {loop_precision:.0%}": found.best_threshold(loop_precision),
    }
    rows = [curve_row(found, *item) for item in best.items()]
    rows += [[name, "", *shares] for name, *shares in without_sensor(scenes, rule)]
    print_table(["", "threshold", *HEADS], rows)
    print(output / "curve.json")
