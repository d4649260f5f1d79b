# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command describe: one descriptor vector per frame."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import OPENING, left_out, progress
from fusionslam.cli.failures import keep
from fusionslam.cli.recordings import build_recording
from fusionslam.descriptors import GROUPS
from fusionslam.help_texts import counted

if TYPE_CHECKING:
    from fusionslam.evaluation import DescriptorRun
    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording


def describe_frames(
    recording: "Recording",
    output: Path,
    names: list[str],
    config: "PipelineConfig",
    *,
    inside: str = "descriptors",
    only_describable: bool = False,
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
) -> "dict[str, DescriptorRun]":
    """Describe what is not described yet; return the runs by the descriptors' names.

    ``only_describable`` drops unsuitable descriptors.
    """
    from fusionslam.pipelines.describe import describable
    from fusionslam.pipelines.recording import warn_of_mistakes
    from fusionslam.pipelines.reusable_runs import describe_recording

    bad_frames = opt.bad_frames(skip_bad_frames)
    with progress() as step:
        step(OPENING, 0, 1)
        dataset = recording.open(config.fusion.source)
        if only_describable:
            names = describable(dataset, names, config, bad_frames)
        step(OPENING, 1, 1)
        runs = describe_recording(
            recording,
            dataset,
            output,
            names,
            config=config,
            jobs=opt.cores(jobs),
            bad_frames=bad_frames,
            command=opt.command_line(),
            step=step,
            inside=inside,
        )
    warn_of_mistakes(dataset, config.fusion.source)
    return dict(zip(names, runs, strict=True))


@opt.options_of(
    build_recording=build_recording,
    pipeline_config=opt.pipeline_config,
    describe_frames=describe_frames,
)
def describe(
    ctx: typer.Context,
    output: opt.Folder = Path("out/describe"),
    descriptors: opt.Names = "usual",
    source: opt.Source = None,
    *,
    build_recording: "Callable[[], Recording]",
    pipeline_config: "Callable[[], PipelineConfig]",
    describe_frames: Callable[..., Any],
) -> None:
    """Describe every frame of DATA.

    An interrupted call resumes where it stopped.
    """
    from fusionslam.pipelines.describe import for_source, run_path

    chosen = pipeline_config()
    names = opt.parse_names(descriptors, chosen.descriptors.preset)
    recording = build_recording()
    chosen = for_source(chosen, opt.choose_source(source, chosen, recording))
    keep(ctx, output)
    runs = describe_frames(
        recording, output, names, chosen, inside=".", only_describable=descriptors in GROUPS
    )
    for name, run in runs.items():
        path = run_path(output, run.source, name)
        print(f"{path}: {counted(len(run), 'frame')}{left_out(run)}")
