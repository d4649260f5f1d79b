# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command views curve: ids judged at many thresholds."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import print_table, progress
from fusionslam.cli.recordings import build_recording, open_scenes
from fusionslam.cli.views.tables import HEADS, curve_row, print_limits, without_sensor
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording
    from fusionslam.views.scene_set import SceneSet


@opt.options_of(
    build_recording=build_recording, views_config=opt.views_config, open_scenes=open_scenes
)
def curve(
    output: opt.Folder = Path("out/views-curve"),
    rule: opt.Rule = "paper",
    loop_precision: Annotated[
        float,
        typer.Option("--loop-precision", min=0, max=1, help="Least loop precision of a threshold."),
    ] = 0.97,
    *,
    build_recording: "Callable[[], Recording]",
    views_config: Callable[[], Any],
    open_scenes: "Callable[..., SceneSet]",
) -> None:
    """Judge the ids at many thresholds, and name the best ones."""
    from fusionslam.pipelines.results import refuse_input
    from fusionslam.pipelines.views import sweep_thresholds
    from fusionslam.views.recognisers import settle_method

    whole = views_config()
    recording = build_recording()
    refuse_input(recording, output)
    with progress() as step:
        scenes = open_scenes(recording, whole, step)
        found = sweep_thresholds(
            scenes,
            settle_method(whole.views, colored=scenes.has_colors, name=scenes.name),
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
    print_limits(scenes, rule)
    print(output / "curve.json")
