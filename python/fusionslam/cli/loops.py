# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The command loops: the loops in a recording, frame after frame."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import left_out, progress
from fusionslam.cli.describe import describe_frames
from fusionslam.cli.failures import keep
from fusionslam.cli.recordings import build_recording
from fusionslam.storage.progress import label_progress

if TYPE_CHECKING:
    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording


@opt.options_of(
    build_recording=build_recording,
    pipeline_config=opt.pipeline_config,
    describe_frames=describe_frames,
)
def loops(
    ctx: typer.Context,
    output: opt.Folder = Path("out/loops"),
    descriptor: Annotated[
        str, typer.Option("--descriptor", "-d", help="m2dp, cm2dp, shot or cshot.")
    ] = "cm2dp",
    threshold: opt.Threshold = None,
    source: opt.Source = None,
    *,
    build_recording: "Callable[[], Recording]",
    pipeline_config: "Callable[[], PipelineConfig]",
    describe_frames: Callable[..., Any],
) -> None:
    """Find the loops in DATA frame after frame, as a robot would."""
    from fusionslam.config import merged
    from fusionslam.descriptors import find_descriptor
    from fusionslam.pipelines.describe import for_source
    from fusionslam.pipelines.loops import find_loops

    name = find_descriptor(descriptor).name
    chosen = pipeline_config()
    if threshold is not None:
        chosen = merged(chosen, {"loop_closure": {"threshold": threshold}})
    recording = build_recording()
    chosen = for_source(chosen, opt.choose_source(source, chosen, recording))
    keep(ctx, output)
    (run,) = describe_frames(recording, output, [name], chosen)
    with progress() as step:
        found = find_loops(run, chosen.loop_closure, label_progress(step, "finding loops"))
    found.save(output / "loops.csv")
    print(f"{found}{left_out(run)}")
    print(output / "loops.csv")
