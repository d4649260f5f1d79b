# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command describe: one descriptor vector per frame."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import left_out, progress
from fusionslam.cli.failures import keep

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset
    from fusionslam.evaluation import DescriptorRun
    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording


@opt.reading_options()
def describe(
    ctx: typer.Context,
    *,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the runs.")],
    descriptors: opt.Names = "all",
    source: opt.Source = None,
    recording: "Recording",
    skip_bad_frames: opt.SkipBad = False,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Describe every frame of DATA.

    A call that was interrupted goes on where it stopped.
    """
    from fusionslam.pipelines.describe import describable, for_source, run_path

    names = opt.names_of(descriptors)
    chosen = opt.pipeline_config(config, settings)
    chosen = for_source(chosen, opt.source_of(source, chosen, recording))
    dataset = recording.open(chosen.fusion.source)
    bad = opt.bad_frames(skip_bad_frames)
    if descriptors == "all":
        names = describable(dataset, names, chosen, bad)
    keep(ctx, output)
    for run in describe_missing(recording, dataset, output, names, chosen, jobs, bad, inside="."):
        path = run_path(output, run.source, run.descriptor)
        print(f"{path}: {len(run)} frames{left_out(run)}")


def describe_missing(
    recording: "Recording",
    dataset: "Dataset",
    output: Path,
    names: list[str],
    config: "PipelineConfig",
    jobs: int | None,
    bad_frames: str,
    inside: str = "descriptors",
) -> "list[DescriptorRun]":
    from fusionslam.pipelines.reusable_runs import describe_recording

    with progress() as step:
        return describe_recording(
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
