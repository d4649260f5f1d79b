# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""The commands describe and loops: a vector per frame, and loops frame after frame."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fusionslam.base.progress import label_progress
from fusionslam.base.texts import counted
from fusionslam.cli import options as opt
from fusionslam.cli.console import during, left_out, progress
from fusionslam.cli.failures import STARTS_REST, keep
from fusionslam.cli.recordings import BuildRecording
from fusionslam.descriptors import GROUPS
from fusionslam.errors import ConfigError

if TYPE_CHECKING:
    from fusionslam.evaluation import DescriptorRun
    from fusionslam.loop_closure.config import LoopConfig
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
        with during(step):
            dataset = recording.open(config.fusion.source)
            if only_describable:
                names = describable(dataset, names, config, bad_frames)
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


@opt.command
def describe(
    ctx: typer.Context,
    output: opt.Folder = Path("out/describe"),
    descriptors: opt.Names = "usual",
    source: opt.Source = None,
    *,
    build_recording: BuildRecording,
    pipeline_config: opt.PipelineConfigOf,
    describe_frames: Annotated[Callable[..., Any], describe_frames],
) -> None:
    """Describe every frame of DATA.

    An interrupted call resumes where it stopped.
    """
    from fusionslam.pipelines.describe import for_source
    from fusionslam.pipelines.results import run_path

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


def prove_loops(
    recording: "Recording",
    output: Path,
    names: list[str],
    config: "PipelineConfig",
    *,
    only_describable: bool,
    skip_bad_frames: opt.SkipBad = False,
    jobs: opt.Jobs = None,
) -> None:
    """Prove the loops of each descriptor, and write and print them."""
    from fusionslam.pipelines.describe import describable
    from fusionslam.pipelines.loops import loops_path
    from fusionslam.pipelines.recording import warn_of_mistakes
    from fusionslam.pipelines.verified_loops import (
        describe_loops,
        verify_recording,
        write_g2o,
        write_loops,
    )

    bad_frames = opt.bad_frames(skip_bad_frames)
    with progress() as step, during(step):
        dataset = recording.open(config.fusion.source)
        if only_describable:
            names = describable(dataset, names, config, bad_frames)
    for name in names:
        with progress() as step:
            run = verify_recording(
                recording,
                dataset,
                output,
                name,
                config=config,
                jobs=opt.cores(jobs),
                bad_frames=bad_frames,
                command=opt.command_line(),
                step=step,
            )
        path = loops_path(output, name if len(names) > 1 else None)
        write_loops(run, path)
        write_g2o(run, path.with_suffix(".g2o"))
        title = f"{name}: " if len(names) > 1 else ""
        print(f"{title}{describe_loops(run)}{left_out(run)}")
        print(path)
    warn_of_mistakes(dataset, config.fusion.source)


@opt.command
def loops(
    ctx: typer.Context,
    output: opt.Folder = Path("out/loops"),
    descriptors: opt.Names = "cm2dp",
    threshold: opt.Threshold = None,
    source: opt.Source = None,
    *,
    build_recording: BuildRecording,
    pipeline_config: opt.PipelineConfigOf,
    describe_frames: Annotated[Callable[..., Any], describe_frames],
    prove_loops: Annotated[Callable[..., Any], prove_loops],
) -> None:
    """Find the loops in DATA frame after frame, as a robot would.

    They are proven by registration unless --threshold is given, and written to loops.csv and
    loops.g2o with their poses; of several descriptors, to loops-DESCRIPTOR.csv each.
    """
    from fusionslam.config import merged
    from fusionslam.descriptors import with_preset
    from fusionslam.pipelines.compare_descriptors import stored_threshold
    from fusionslam.pipelines.describe import describable, for_source
    from fusionslam.pipelines.loops import find_loops, loops_path
    from fusionslam.pipelines.verified_loops import new_detector

    chosen = pipeline_config()
    names = opt.parse_names(descriptors, chosen.descriptors.preset)
    distance = None if threshold is None else _as_distance(threshold)
    if distance is not None:
        chosen = merged(chosen, {"loop_closure": {"threshold": distance}})
    recording = build_recording()
    chosen = for_source(chosen, opt.choose_source(source, chosen, recording))
    every = descriptors in GROUPS
    # Its enumeration is private to typer in some versions.
    given = ctx.get_parameter_source("descriptors")
    if given is not None and given.name == "DEFAULT":
        dataset = recording.open(chosen.fusion.source)
        names = describable(dataset, names, chosen, "skip", replace=True)

    @cache
    def config_of(name: str) -> "LoopConfig":
        if threshold is None or distance is not None:
            return chosen.loop_closure
        own = with_preset(name, chosen.descriptors)
        taken = stored_threshold(threshold, chosen.fusion.source, own)
        return merged(chosen.loop_closure, {"threshold": taken})

    if not every:  # of all, some may turn out not to be describable
        for name in names:
            config_of(name)
    if threshold is None and new_detector(chosen, names[0]).verifies:
        keep(ctx, output, STARTS_REST)
        prove_loops(recording, output, names, chosen, only_describable=every)
        return
    keep(ctx, output)
    runs = describe_frames(recording, output, names, chosen, only_describable=every)
    for name, run in runs.items():
        with progress() as step:
            found = find_loops(run, config_of(name), label_progress(step, "finding loops"))
        path = loops_path(output, name if len(names) > 1 else None)
        # Of a former run, whose loops were proven.
        path.with_suffix(".g2o").unlink(missing_ok=True)
        found.save(path)
        print(f"{f'{name}: ' if len(names) > 1 else ''}{found}{left_out(run)}")
        print(path)


def _as_distance(threshold: str) -> float | None:
    """Return the number that was given; None for a folder. Raises ConfigError for neither."""
    try:
        return float(threshold)
    except ValueError:
        if Path(threshold).is_dir():
            return None
        raise ConfigError(
            f"--threshold is {threshold!r}, expected a distance, or a folder of bench",
            code="choice",
            fields=("--threshold", threshold),
        ) from None
