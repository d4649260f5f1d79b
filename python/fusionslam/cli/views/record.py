# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command views record: a recording as a scene set."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import progress
from fusionslam.cli.recordings import build_recording, open_scenes
from fusionslam.help_texts import counted
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording
    from fusionslam.views.scene_set import SceneSet


@opt.options_of(
    build_recording=build_recording,
    views_config=opt.views_config,
    open_scenes=partial(open_scenes, skip_empty=False),
)
def record(
    output: Annotated[Path, typer.Option("--output", "-o", help="The scene set, a .npz.")],
    features: Annotated[
        str, typer.Option("--features", metavar="NAMES", help="Descriptors to store as well.")
    ] = "",
    only_scenes: Annotated[
        bool, typer.Option("--only-scenes", help="Store scenes as configured, but no clouds.")
    ] = False,
    *,
    build_recording: "Callable[[], Recording]",
    views_config: Callable[[], Any],
    open_scenes: "Callable[..., SceneSet]",
) -> None:
    """Record DATA as a scene set: clouds without ground, true poses, descriptors."""
    from dataclasses import replace

    from fusionslam.views.recognisers import scene_config

    whole = views_config()
    names = opt.parse_names(features) if features else []
    target = output if output.suffix == ".npz" else output.with_name(f"{output.name}.npz")
    opt.check_output(target, build_recording, views_config)
    recording = build_recording()
    with progress() as step:
        scenes = open_scenes(recording, whole, step, features=names)
        if only_scenes:
            made = scene_config(whole.views)
            scenes = scenes.with_scenes(made, label_progress(step, "building")).without_clouds()
    replace(scenes, source={**scenes.source, "command": opt.command_line()}).save(target)
    truth = ", no true poses" if scenes.poses is None else ""
    print(f"{target}: {counted(len(scenes), 'scan')}, {int(scenes.empty.sum())} empty{truth}")
