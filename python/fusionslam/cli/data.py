# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Commands that read recordings: info, fuse, describe, loops."""

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fusionslam.cli import options as opt
from fusionslam.cli.console import Step, left_out, print_table, progress
from fusionslam.cli.failures import keep, needs_extra

if TYPE_CHECKING:
    from fusionslam.datasets import Dataset
    from fusionslam.evaluation import DescriptorRun
    from fusionslam.fusion import FusionConfig
    from fusionslam.pipelines.describe import PipelineConfig
    from fusionslam.pipelines.recording import Recording

logger = logging.getLogger(__name__)


def info(
    data: opt.Data,
    kind: opt.KindOption = None,
    sequence: opt.Sequence = None,
    topic: opt.Topics = None,
    stamps: opt.StampsOption = "header",
    sync: opt.SyncOption = None,
    calib: opt.Calibration = None,
    gt: opt.Truth = None,
    verbose: opt.Verbose = False,
) -> None:
    """Say what is in DATA: frames, sensors, calibration, poses, gaps."""
    from fusionslam.pipelines.overview import look_at

    recording = opt.recording_of(data, kind, sequence, True, gt, topic, stamps, sync, calib)
    print_table(["what", "value"], look_at(recording).rows)


def fuse(
    ctx: typer.Context,
    data: opt.Data,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for the clouds, or a bag: .bag, .db3, .mcap."),
    ],
    source: opt.Source = None,
    format: Annotated[
        str | None,
        typer.Option("--format", help="Of a folder: ply (default), pcd, or bin, without colours."),
    ] = None,
    kind: opt.KindOption = None,
    sequence: opt.Sequence = None,
    topic: opt.Topics = None,
    stamps: opt.StampsOption = "header",
    sync: opt.SyncOption = None,
    calib: opt.Calibration = None,
    skip_gaps: opt.SkipGaps = False,
    pictures: Annotated[
        int, typer.Option("--pictures", metavar="N", min=0, help="Draw the steps of N frames.")
    ] = 0,
    gt: opt.Truth = None,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Write DATA's coloured clouds as a folder or bag to open again.

    Their times and poses, if there are any, lie beside them. Pictures of the steps go to the
    folder's pictures/, or beside the bag.
    """
    from fusionslam.pipelines.compare_descriptors import for_source

    recording = opt.recording_of(data, kind, sequence, skip_gaps, gt, topic, stamps, sync, calib)
    chosen = opt.pipeline_config(config, settings)
    asked_for = source is not None or "source" in chosen.fusion.model_fields_set
    chosen = for_source(chosen, opt.source_of(source, chosen, recording))
    if chosen.fusion.source == "cloud" and not asked_for:
        _warn_of_missing_colors(recording)
    if pictures:
        needs_extra("report")
    with progress() as step:
        count = _write_fused(ctx, recording, output, chosen.fusion, format, opt.cores(jobs), step)
        if pictures:
            _draw_stages(recording, output, chosen.fusion, pictures, step)
    print(f"{output}: {count} frames")


def _warn_of_missing_colors(recording: "Recording") -> None:
    """Say that clouds stay without colours where nobody has asked for that."""
    from contextlib import suppress

    from fusionslam.errors import DataError

    # What is wrong with a frame is said when it is fused.
    with suppress(DataError):
        if recording.open("cloud")[0].colors is None:
            logger.warning(
                "%s has no images with a calibration (CameraInfo): clouds have no colours "
                "(source cloud)",
                recording.path,
            )


def _write_fused(
    ctx: typer.Context,
    recording: "Recording",
    output: Path,
    config: "FusionConfig",
    format: str | None,
    jobs: int,
    step: Step,
) -> int:
    """The number of frames written."""
    from fusionslam.errors import ConfigError
    from fusionslam.pipelines.export_bag import BAG_SUFFIXES, write_cloud_bag
    from fusionslam.pipelines.export_folder import write_clouds

    count = 0

    def show(done: int, total: int) -> None:
        nonlocal count
        count = done
        step("fusing", done, total)

    if output.suffix.lower() in BAG_SUFFIXES:
        if format is not None:
            raise ConfigError(f"--format {format} is for folders of clouds, {output} is a bag")
        needs_extra("bags")
        write_cloud_bag(recording, output, config, jobs=jobs, progress=show)
        return count
    keep(ctx, output)
    write_clouds(
        recording,
        output,
        config,
        format=format or "ply",
        jobs=jobs,
        command=opt.command_line(),
        progress=show,
    )
    return count


def _draw_stages(
    recording: "Recording", output: Path, config: "FusionConfig", count: int, step: Step
) -> None:
    from fusionslam.pipelines.export_bag import BAG_SUFFIXES
    from fusionslam.report.fusion_stages import write_stages

    is_bag = output.suffix.lower() in BAG_SUFFIXES
    folder = output.with_suffix(".pictures") if is_bag else output / "pictures"
    dataset = recording.open(config.source)
    write_stages(dataset, folder, config, count, lambda done, total: step("drawing", done, total))


def describe(
    ctx: typer.Context,
    data: opt.Data,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the runs.")],
    descriptors: opt.Names = "all",
    source: opt.Source = None,
    kind: opt.KindOption = None,
    sequence: opt.Sequence = None,
    topic: opt.Topics = None,
    stamps: opt.StampsOption = "header",
    sync: opt.SyncOption = None,
    calib: opt.Calibration = None,
    skip_gaps: opt.SkipGaps = False,
    skip_bad_frames: opt.SkipBad = False,
    gt: opt.Truth = None,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Describe every frame of DATA.

    A call that was interrupted goes on where it stopped.
    """
    from fusionslam.pipelines import compare_descriptors
    from fusionslam.pipelines.describe import run_path

    names = opt.names_of(descriptors)
    recording = opt.recording_of(data, kind, sequence, skip_gaps, gt, topic, stamps, sync, calib)
    chosen = opt.pipeline_config(config, settings)
    chosen = compare_descriptors.for_source(chosen, opt.source_of(source, chosen, recording))
    dataset = recording.open(chosen.fusion.source)
    bad = opt.bad_frames(skip_bad_frames)
    if descriptors == "all":
        names = compare_descriptors.describable(dataset, names, chosen, bad)
    keep(ctx, output)
    for run in _described(recording, dataset, output, names, chosen, jobs, bad, inside="."):
        path = run_path(output, run.source, run.descriptor)
        print(f"{path}: {len(run)} frames{left_out(run)}")


def loops(
    ctx: typer.Context,
    data: opt.Data,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for loops and runs.")],
    descriptor: Annotated[
        str, typer.Option("--descriptor", "-d", help="m2dp, cm2dp, shot or cshot.")
    ] = "cm2dp",
    threshold: opt.Threshold = None,
    source: opt.Source = None,
    kind: opt.KindOption = None,
    sequence: opt.Sequence = None,
    topic: opt.Topics = None,
    stamps: opt.StampsOption = "header",
    sync: opt.SyncOption = None,
    calib: opt.Calibration = None,
    skip_gaps: opt.SkipGaps = False,
    skip_bad_frames: opt.SkipBad = False,
    gt: opt.Truth = None,
    settings: opt.Settings = None,
    config: opt.ConfigFile = None,
    jobs: opt.Jobs = None,
    verbose: opt.Verbose = False,
) -> None:
    """Find the loops in DATA frame after frame, as a robot would."""
    from fusionslam.config import merged
    from fusionslam.descriptors import descriptor_named
    from fusionslam.pipelines.compare_descriptors import for_source
    from fusionslam.pipelines.loops import find_loops

    name = descriptor_named(descriptor).name
    recording = opt.recording_of(data, kind, sequence, skip_gaps, gt, topic, stamps, sync, calib)
    chosen = opt.pipeline_config(config, settings)
    if threshold is not None:
        chosen = merged(chosen, {"loop_closure": {"threshold": threshold}})
    chosen = for_source(chosen, opt.source_of(source, chosen, recording))
    dataset = recording.open(chosen.fusion.source)
    keep(ctx, output)
    bad = opt.bad_frames(skip_bad_frames)
    (run,) = _described(recording, dataset, output, [name], chosen, jobs, bad)
    with progress() as step:
        found = find_loops(
            run, chosen.loop_closure, lambda done, total: step("finding loops", done, total)
        )
    found.save(output / "loops.csv")
    print(f"{found}{left_out(run)}")
    print(output / "loops.csv")


def _described(
    recording: "Recording",
    dataset: "Dataset",
    output: Path,
    names: list[str],
    config: "PipelineConfig",
    jobs: int | None,
    bad_frames: str,
    inside: str = "descriptors",
) -> "list[DescriptorRun]":
    from fusionslam.pipelines.compare_descriptors import work_on

    with progress() as step:
        return work_on(
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
