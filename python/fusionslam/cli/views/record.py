# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command views record: a recording as a scene set."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.views import options as view
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording
    from fusionslam.views.scene_set import SceneSet


@opt.reading_options()
def record(
    *,
    output: Annotated[Path, typer.Option("--output", "-o", help="The scene set, a .npz.")],
    features: Annotated[
        str, typer.Option("--features", metavar="NAMES", help="Descriptors to keep, too.")
    ] = "",
    only_scenes: Annotated[
        bool, typer.Option("--only-scenes", help="Keep scenes as configured, no clouds: small.")
    ] = False,
    recording: "Recording",
    tuned: view.Tuned = None,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Write what a robot saw as a scene set: clouds without ground, true poses, descriptors."""
    from dataclasses import replace

    from fusionslam.views.recognisers import scene_config

    whole = view.build_config(tuned, config, settings)
    names = opt.names_of(features) if features else []
    target = output if output.suffix == ".npz" else output.with_name(f"{output.name}.npz")
    with progress() as step:
        scenes = view.open_scenes(recording, whole, step, jobs=opt.cores(jobs), features=names)
        if only_scenes:
            made = scene_config(whole.views)
            scenes = scenes.with_scenes(made, label_progress(step, "building")).without_clouds()
    replace(scenes, source={**scenes.source, "command": opt.command_line()}).save(target)
    print(f"{target}: {len(scenes)} scans, {int(scenes.empty.sum())} empty{_truth(scenes)}")


def _truth(scenes: "SceneSet") -> str:
    return ", no true poses" if scenes.poses is None else ""
