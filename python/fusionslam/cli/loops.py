# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command loops: the loops in a recording, frame after frame."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import left_out, progress
from fusionslam.cli.describe import describe_missing
from fusionslam.cli.failures import keep
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.pipelines.recording import Recording


@opt.reading_options()
def loops(
    ctx: typer.Context,
    *,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for loops and runs.")],
    descriptor: Annotated[
        str, typer.Option("--descriptor", "-d", help="m2dp, cm2dp, shot or cshot.")
    ] = "cm2dp",
    threshold: opt.Threshold = None,
    source: opt.Source = None,
    recording: "Recording",
    skip_bad_frames: opt.SkipBad = False,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Find the loops in DATA frame after frame, as a robot would."""
    from fusionslam.config import merged
    from fusionslam.descriptors import descriptor_named
    from fusionslam.pipelines.describe import for_source
    from fusionslam.pipelines.loops import find_loops

    name = descriptor_named(descriptor).name
    chosen = opt.pipeline_config(config, settings)
    if threshold is not None:
        chosen = merged(chosen, {"loop_closure": {"threshold": threshold}})
    chosen = for_source(chosen, opt.source_of(source, chosen, recording))
    dataset = recording.open(chosen.fusion.source)
    keep(ctx, output)
    bad = opt.bad_frames(skip_bad_frames)
    (run,) = describe_missing(recording, dataset, output, [name], chosen, jobs, bad)
    with progress() as step:
        found = find_loops(run, chosen.loop_closure, label_progress(step, "finding loops"))
    found.save(output / "loops.csv")
    print(f"{found}{left_out(run)}")
    print(output / "loops.csv")
